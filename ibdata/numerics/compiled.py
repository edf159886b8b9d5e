"""Compiled functions, and where their machine code is kept.

numba's own cache asks only whether the file of a function is the one it was compiled from: it misses a change
in a function that is called. The cache here lies in a folder named by the digest of all compiled sources, so
old code can never run.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

from ibdata.errors import UsageError
from ibdata.system.cache_folders import Places

try:
    import numba
except ValueError as error:  # it reads its variables when it is imported
    names = ", ".join(sorted(name for name in os.environ if name.startswith("NUMBA_")))
    raise UsageError(f"{names}: numba refuses this setting: {error} Correct or unset it.") from None

from ibdata.numerics.code_cache import CodeCache

F = TypeVar("F", bound=Callable[..., object])

PACKAGE = Path(__file__).resolve().parents[1]
SOURCES = (
    *("numerics/*.py", "dynamics/*.py", "policies/*.py", "simulation/*.py"),
    *("system/cache_folders.py", "system/private_files.py", "writing/statistics.py"),
)


def compiled(function: F) -> F:
    """`numba.njit` with fastmath off and its code in `PLACES`; plain Python under NUMBA_DISABLE_JIT=1.

    It lets go of Python's lock, so that what is simulated can be encoded and hashed meanwhile. A division by
    zero, which no equation has, would give an infinity: a test for it would keep loops from being vectorized.
    """
    made: Any = numba.njit(nogil=True, error_model="numpy")(function)
    if made is not function:
        made._cache = CodeCache(function, PLACES)  # as cache=True does, with numba's own cache
    return cast(F, made)


def is_compiled() -> bool:
    """Whether machine code has been kept by an earlier run, or none is needed."""
    config: Any = numba.config
    return bool(config.DISABLE_JIT) or any(any(Path(folder).glob("*.nbc")) for folder in PLACES.folders)


def is_kept() -> bool:
    """Whether machine code outlives this process, as far as can be told before it is written."""
    return PLACES.lasting


def _digest() -> str:
    hasher = hashlib.sha256(f"{numba.__version__} {sys.implementation.cache_tag}".encode())
    for pattern in SOURCES:
        for path in sorted(PACKAGE.glob(pattern)):
            hasher.update(path.read_bytes())
    return hasher.hexdigest()[:16]


PLACES = Places(f"numba-{_digest()}")
