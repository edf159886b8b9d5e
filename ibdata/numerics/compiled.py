"""The decorator of compiled functions, and the folder of their machine code.

numba's own cache only checks whether the file of a function has changed, so it misses changes in the
functions that this one calls. Here the folder of the cache is named after a digest of all compiled sources,
so outdated code never runs.
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
except ValueError as error:  # numba reads its environment variables on import
    names = ", ".join(sorted(name for name in os.environ if name.startswith("NUMBA_")))
    raise UsageError(f"{names}: numba refuses this setting: {error} Correct or unset it.") from None

from ibdata.numerics.code_cache import CodeCache

F = TypeVar("F", bound=Callable[..., object])

PACKAGE = Path(__file__).resolve().parents[1]
SOURCES = (
    *("numerics/*.py", "dynamics/*.py", "policies/*.py", "simulation/*.py"),
    *("system/cache_folders.py", "system/private_files.py", "variables.py", "dataset/statistics.py"),
)


def compiled(function: F) -> F:
    """Compile a function with `numba.njit`, without fastmath, and keep its machine code in `PLACES`.

    Machine code of functions outside of ibdata is not kept, because the digest is only of ibdata's sources.
    With NUMBA_DISABLE_JIT=1 it stays plain Python. Compiled code releases Python's global lock, so that other
    threads can encode and hash meanwhile. numba's check for division by zero is off, because it prevents
    loops from being vectorized; no equation divides by zero.
    """
    return _compiled(function)


def inlined(function: F) -> F:
    """As `compiled`, with its machine code repeated in its callers'.

    For functions that handle many arrays: a call counts references to each, which takes longer than the work
    on one lane.
    """
    return _compiled(function, inline=True)


def _compiled(function: F, inline: bool = False) -> F:
    made: Any = numba.njit(nogil=True, error_model="numpy", forceinline=inline)(function)
    if made is not function and function.__module__.startswith(f"{PACKAGE.name}."):
        made._cache = CodeCache(function, PLACES)  # what cache=True does with numba's own cache
    return cast(F, made)


def _digest() -> str:
    hasher = hashlib.sha256(f"{numba.__version__} {sys.implementation.cache_tag}".encode())
    for pattern in SOURCES:
        for path in sorted(PACKAGE.glob(pattern)):
            hasher.update(path.read_bytes())
    return hasher.hexdigest()[:16]


PLACES = Places(f"numba-{_digest()}")
