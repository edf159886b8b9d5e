"""The decorator of compiled functions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

from ibdata.numerics.code_cache import CodeCache

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile a function with `numba.njit`, without fastmath, and keep its machine code.

    That of functions outside of ibdata is not kept, because the cache only follows imports within ibdata.
    With NUMBA_DISABLE_JIT=1 it stays plain Python. Compiled code releases Python's global lock, so that other
    threads can encode and hash meanwhile. numba's check for division by zero is off, because it prevents
    loops from being vectorized; no equation divides by zero.
    """
    return _compiled(function)


def inlined(function: F) -> F:
    """As `compiled`, but its code is repeated in its callers' before they are compiled.

    For functions that handle many arrays, whose every call would count references to each, which takes longer
    than the work on one lane. It also saves compiling them alone.
    """
    return _compiled(function, inline=True)


def _compiled(function: F, inline: bool = False) -> F:
    options: Any = {"inline": "always" if inline else "never", "no_cfunc_wrapper": True}
    made: Any = numba.njit(nogil=True, error_model="numpy", **options)(function)
    if made is not function and function.__module__.startswith("ibdata."):
        made._cache = CodeCache(function)  # what cache=True does with numba's own cache
    return cast(F, made)
