"""Folders for machine code, and for datasets that are made before they are uploaded."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import suppress

from ibdata.system.private_files import make, opened, resolved, write

PASSING = "IBDATA_PASSING_CACHE"  # holds the path of the temporary folder, for worker processes


class Places:
    """The cache folders with one name, each in a base folder to which no other user can write.

    Only the last one may be writable; those before it are read-only, as in a container image. If none is
    writable, or writing fails, a temporary folder is used; if that fails too, nothing is kept.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.folders: list[str] = []
        self.lasting = False
        for base in _bases():
            with suppress(OSError):
                self.lasting = self._take(base)
                if self.lasting:
                    break
        if PASSING in os.environ or not self.lasting:
            self._take_temporary()

    def keep(self, name: str, content: bytes) -> None:
        """Write a file to the first folder that can be written to."""
        if not self._put(name, content) and self._take_temporary():
            self._put(name, content)

    def _put(self, name: str, content: bytes) -> bool:
        for folder in self.folders:
            with suppress(OSError):
                write(folder, name, content)
                return True
        return False

    def _take(self, base: str) -> bool:
        """Add the folder in a base; return whether it is writable."""
        make(base)
        with opened(base) as at, suppress(FileExistsError):
            os.mkdir(self.name, 0o700, dir_fd=at)
        folder = os.path.join(base, self.name)
        with opened(folder):
            self.folders.append(folder)
        return os.access(folder, os.W_OK)

    def _take_temporary(self) -> bool:
        """Add the temporary folder; return whether it is new and writable."""
        with suppress(OSError):
            base = _temporary_base()
            return os.path.join(base, self.name) not in self.folders and self._take(base)
        return False


def cache_base() -> str:
    """The first base folder that is writable, or else a temporary one, for whole folders."""
    for base in _bases():
        with suppress(OSError):
            make(base)
            with opened(base):
                if os.access(base, os.W_OK):
                    return base
    return _temporary_base()


def _bases() -> Iterator[str]:
    """The base folders that the environment names, then the user's cache, as absolute paths without links."""
    for variable in ("IBDATA_CACHE_DIR", "NUMBA_CACHE_DIR"):
        asked = os.path.expanduser(os.environ.get(variable, ""))
        if asked and not asked.startswith("~"):  # a ~ stays if there is no HOME, or no such user
            yield from _resolved(asked)
    own = os.path.expanduser(os.path.join(os.environ.get("XDG_CACHE_HOME") or "~/.cache", "ibdata"))
    if os.path.isabs(own):  # a relative path may lead to anybody's folder
        yield from _resolved(own)


def _resolved(base: str) -> Iterator[str]:
    with suppress(OSError):
        yield resolved(base)


def _temporary_base() -> str:
    """A folder that is removed when this process ends; worker processes find it through the environment."""
    if PASSING not in os.environ:
        folder = tempfile.mkdtemp(prefix="ibdata-")
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        os.environ[PASSING] = os.path.realpath(folder)
    return os.environ[PASSING]
