"""Refusing requests that this machine's memory cannot hold."""

from __future__ import annotations

import os

from ibdata.errors import UsageError


def refuse_too_much(what: str, size: int) -> None:
    """Raise UsageError if a request needs more bytes than the machine's memory has."""
    most = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if size > most:
        raise UsageError(
            f"{what}: this number takes {size // 10**9} GB of memory, but this machine has "
            f"{most // 10**9} GB; choose a smaller one"
        )
