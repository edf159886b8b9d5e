"""Refusing requests that this machine's memory cannot hold."""

from __future__ import annotations

import os
import sys

from ibdata.errors import UsageError


def refuse_too_much(what: str, size: int) -> None:
    """Raise UsageError if a request needs more bytes than the machine's memory has."""
    most = memory()
    if size > most:
        raise UsageError(
            f"{what}: this number takes {size // 10**9} GB of memory, but this machine has "
            f"{most // 10**9} GB; choose a smaller one"
        )


if sys.platform == "win32":

    def memory() -> int:
        """The bytes of this machine's memory."""
        import ctypes

        status = (ctypes.c_uint64 * 8)(64)  # MEMORYSTATUSEX: its size, all memory, and six numbers more
        ctypes.windll.kernel32.GlobalMemoryStatusEx(status)
        return status[1]

else:

    def memory() -> int:
        """The bytes of this machine's memory, or without a limit where the system does not tell them."""
        try:
            return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
        except (AttributeError, ValueError):
            return sys.maxsize
