"""Folders for what is kept between processes: machine code."""

from __future__ import annotations

import atexit
import os
import shutil
import sys
import tempfile
from contextlib import suppress
from functools import cache
from typing import NamedTuple


class CacheFolders(NamedTuple):
    """Folders to look into; only the last one is written to. Later processes find it if it is `lasting`."""

    folders: tuple[str, ...]
    lasting: bool


@cache
def cache_folders() -> CacheFolders:
    """The folder that IBDATA_CACHE_DIR names, and the user's cache if the first one is read-only or not set.

    If neither can be written to, a temporary folder, which this process removes at its end, is the last.
    """
    folders: list[str] = []
    variable = "LOCALAPPDATA" if sys.platform == "win32" else "XDG_CACHE_HOME"
    user = os.environ.get(variable) or "~/.cache"
    for folder in (os.environ.get("IBDATA_CACHE_DIR", ""), os.path.join(user, "ibdata")):
        path = os.path.expanduser(folder)
        with suppress(OSError):
            if not path or path.startswith("~"):  # not set, or a user without a home
                continue
            os.makedirs(path, 0o700, exist_ok=True)
            folders.append(os.path.abspath(path))
            if os.access(path, os.W_OK):
                return CacheFolders(tuple(folders), True)
    with suppress(OSError):
        folders.append(tempfile.mkdtemp(prefix="ibdata-"))
        atexit.register(shutil.rmtree, folders[-1], ignore_errors=True)
    return CacheFolders(tuple(folders), False)
