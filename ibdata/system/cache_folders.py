"""Folders for machine code, and for datasets that are made before they are uploaded."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import suppress

from ibdata.system.private_files import make, opened, resolved, write

PASSING = "IBDATA_PASSING_CACHE"  # names the passing folder to worker processes


class Places:
    """Folders of one name, in the bases that this user alone can write to; the last is where more is kept.

    Those before it can be read only, as in the image of a container. Where none can be written, or writing
    fails, a passing folder serves; where that fails too, nothing is kept.
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
            self._take_passing()

    def keep(self, name: str, content: bytes) -> None:
        """Put a file into the first folder that takes it."""
        if not self._put(name, content) and self._take_passing():
            self._put(name, content)

    def _put(self, name: str, content: bytes) -> bool:
        for folder in self.folders:
            with suppress(OSError):
                write(folder, name, content)
                return True
        return False

    def _take(self, base: str) -> bool:
        """Add the folder in a base, which must be this user's alone; whether it can be written to."""
        make(base)
        with opened(base) as at, suppress(FileExistsError):
            os.mkdir(self.name, 0o700, dir_fd=at)
        folder = os.path.join(base, self.name)
        with opened(folder):
            self.folders.append(folder)
        return os.access(folder, os.W_OK)

    def _take_passing(self) -> bool:
        """Add the passing folder; whether that is new and can be written to."""
        with suppress(OSError):
            return os.path.join(_passing(), self.name) not in self.folders and self._take(_passing())
        return False


def cache_base() -> str:
    """The first base that can be written, where whole folders may be kept."""
    for base in _bases():
        with suppress(OSError):
            make(base)
            with opened(base):
                if os.access(base, os.W_OK):
                    return base
    return _passing()


def _bases() -> Iterator[str]:
    """The folders that are asked for, then the user's cache, as absolute paths without links."""
    for variable in ("IBDATA_CACHE_DIR", "NUMBA_CACHE_DIR"):
        asked = os.path.expanduser(os.environ.get(variable, ""))
        if asked and not asked.startswith("~"):  # it stays where there is neither HOME nor such a user
            yield from _resolved(asked)
    own = os.path.expanduser(os.path.join(os.environ.get("XDG_CACHE_HOME") or "~/.cache", "ibdata"))
    if os.path.isabs(own):  # one in the folder that ibdata is called from may be anybody's
        yield from _resolved(own)


def _resolved(base: str) -> Iterator[str]:
    with suppress(OSError):
        yield resolved(base)


def _passing() -> str:
    """A folder that goes when this process ends, of which worker processes know from the environment."""
    if PASSING not in os.environ:
        folder = tempfile.mkdtemp(prefix="ibdata-")
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        os.environ[PASSING] = os.path.realpath(folder)
    return os.environ[PASSING]
