"""Compiled functions, and where their machine code is kept.

numba's own cache asks only whether the file of a function is the one it was compiled from, by time and
size: it misses a change in a function that is called, and wheels give every file the same time. The cache
here lies in a folder named by the digest of all compiled sources, so old code can never run.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])

PACKAGE = Path(__file__).resolve().parent
SOURCES = (
    *("compiling.py", "philox.py", "noise.py", "packed.py", "lanes.py"),
    *("dataset/statistics.py", "dynamics/*.py", "policies/*.py"),
)


def compiled(function: F) -> F:
    """`numba.njit` with fastmath off and the cache in `FOLDER`; plain Python under NUMBA_DISABLE_JIT=1.

    It lets go of Python's lock, so that what is simulated can be encoded and hashed meanwhile. A division by
    zero, which no equation has, would give an infinity: a test for it would keep loops from being vectorized.
    """
    config: Any = numba.config
    before = config.CACHE_DIR
    config.CACHE_DIR = FOLDER  # numba decides where a function is kept when it is decorated
    try:
        return cast(F, numba.njit(cache=True, nogil=True, error_model="numpy")(function))
    finally:
        config.CACHE_DIR = before


def is_compiled() -> bool:
    """Whether this Python finds machine code of the rollout's last function in `FOLDER`, or needs none."""
    version = f"py{sys.version_info.major}{sys.version_info.minor}"
    config: Any = numba.config
    return bool(config.DISABLE_JIT) or any(Path(FOLDER).glob(f"*/lanes.assemble-*.{version}*.nbi"))


def _folder() -> str:
    """The first folder that can be written, of those asked for, the user's cache, and a passing one."""
    name = f"numba-{_digest()}"
    for base in _bases():
        folder = os.path.join(base, name)
        try:
            os.makedirs(folder, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                return folder
        except OSError:
            continue
    passing = tempfile.mkdtemp(prefix="ibdata-")
    atexit.register(shutil.rmtree, passing, ignore_errors=True)
    os.environ["IBDATA_CACHE_DIR"] = passing  # worker processes find the same folder in it
    return os.path.join(passing, name)


def cache_base() -> str:
    """The folder that is asked for to keep things in."""
    return next(_bases())


def _bases() -> Iterator[str]:
    for variable in ("IBDATA_CACHE_DIR", "NUMBA_CACHE_DIR"):
        if os.environ.get(variable):
            yield os.environ[variable]
    yield os.path.join(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "ibdata")


def _digest() -> str:
    hasher = hashlib.sha256(numba.__version__.encode())
    for pattern in SOURCES:
        for path in sorted(PACKAGE.glob(pattern)):
            hasher.update(path.read_bytes())
    return hasher.hexdigest()[:16]


FOLDER = _folder()
