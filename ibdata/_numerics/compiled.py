"""The decorator of compiled functions, whose machine code is kept between processes in numba's own cache.

numba only compares a function's own file, so it misses changes in the functions that this one calls. Here
the names of the files hold a hash of the module of the function and of those that it imports, without lines
and comments, so that outdated code is never found. Copies of ibdata in other folders share the machine code.

This relies on details of numba: that its classes of caches take a locator, that the compiler calls
`load_overload` before it compiles and `save_overload` afterwards, and that kept machine code needs numba's
runtime only, so that `_load_overload` does without the compiler's imports, which take 0.1 s.

numba would also read `.numba_config.yaml` in the current folder, when it is imported and before it compiles.
The file may be somebody else's and name the folder from which machine code is loaded, so ibdata lets numba
find no such file.
"""

from __future__ import annotations

import glob
import hashlib
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache, cached_property
from importlib.util import find_spec
from pathlib import Path
from types import CodeType
from typing import Any, TypeVar, cast

from ibdata._system.cache_folders import cache_folders
from ibdata._system.imports import without_file
from ibdata.errors import notice

with without_file(".numba_config.yaml"):
    import numba
    from numba.core import config
    from numba.core.caching import CompileResultCacheImpl, FunctionCache, NullCache, _CacheLocator
    from numba.core.dispatcher import Dispatcher
    from numba.core.runtime.nrt import rtsys

config._config_fname = ""  # for all later compilations
config.reload_config()  # changes something only if numba was imported before, and read the file


class Announcement:
    """Says once in a process that functions are being compiled, and counts them while they are."""

    def __init__(self) -> None:
        self._under_way = 0  # functions that are being compiled, each for the one before it
        self._made = 0
        self._text = ""

    def begin(self, module: str) -> None:
        """Note that a function of a module is about to be compiled."""
        if not self._text:
            self._text = _text(module)
            notice(self._text)
        self._under_way += 1
        self._show()

    def end(self) -> None:
        """Note that the function has been compiled."""
        self._under_way -= 1
        self._made += 1
        self._show()

    def _show(self) -> None:
        if sys.stderr.isatty():
            of_all = f" of about {FUNCTIONS}" if SIMULATOR in self._text else ""
            line = f"ibdata: functions compiled: {self._made}{of_all}" if self._under_way else ""
            print(f"\r\033[K{line}", end="", file=sys.stderr, flush=True)


def _text(module: str) -> str:
    """What is compiled, how long it takes, and how often."""
    places = cache_folders()
    is_first = not any(any(Path(folder, "numba").glob("*.nbc")) for folder in places.folders)
    what = f"{SIMULATOR}, in about 12 seconds" if is_first else f"{module}, in a few seconds"
    every = ", in every run because no cache folder can be written to; set IBDATA_CACHE_DIR to one"
    return f"compiling {what}{', once' if places.lasting else every}"


# That hold compiled functions, and the constants in them.
ROOMS = ("_numerics", "dynamics", "_simulation", "policies", "dataset.statistics", "views.variables")
SIMULATOR, FUNCTIONS = "the simulator", 66  # its functions, and those of the policy `random`
ANNOUNCEMENT = Announcement()


class CodeCache(NullCache):
    """The cache of one function: that of numba in each of the cache folders."""

    def __init__(self, function: Callable[..., object]) -> None:
        self._function = function

    @cached_property
    def _caches(self) -> list[FunctionCache]:
        """Made when first needed, because the function's module must be complete."""
        return [_cache_in(folder)(self._function) for folder in cache_folders().folders]

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The machine code for a signature, or None if it must be compiled."""
        rtsys.initialize(target_context)
        for each in self._caches:
            try:
                found = each._load_overload(sig, target_context)
            except Exception:  # whatever a damaged file leads to
                with suppress(OSError):
                    each.flush()
                continue
            if found is not None:
                return found
        _leave_scipy_out()
        ANNOUNCEMENT.begin(self._function.__module__)
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the machine code for a signature, which has been compiled since `load_overload`."""
        with suppress(OSError):
            for each in self._caches[-1:]:
                each.save_overload(sig, data)
        ANNOUNCEMENT.end()


@cache
def _cache_in(folder: str) -> type[FunctionCache]:
    """numba's cache in a folder."""

    class Locator(_CacheLocator):
        def __init__(self, function: Callable[..., object]) -> None:
            self._module = function.__module__
            self._py_file = function.__code__.co_filename  # for a warning of numba's

        def get_cache_path(self) -> str:
            return os.path.join(folder, "numba")

        def get_source_stamp(self) -> str:
            return _hash(self._module)

        def get_disambiguator(self) -> str:
            return _hash(self._module)[:16]

    class Impl(CompileResultCacheImpl):
        def __init__(self, function: Callable[..., object]) -> None:
            """As numba's, which would look for the locators of NUMBA_CACHE_LOCATOR_CLASSES first."""
            self._lineno = function.__code__.co_firstlineno
            self._locator = Locator(function)
            self._filename_base = self.get_filename_base(function.__qualname__, getattr(sys, "abiflags", ""))

    class InFolder(FunctionCache):
        _impl_class = Impl

    return InFolder


@cache
def _hash(module: str) -> str:
    """The hash of a module's code, and of that of all modules of `ROOMS` that it imports."""
    hasher = hashlib.sha256(f"{numba.__version__} {sys.implementation.cache_tag} {module}".encode())
    for name in sorted(_imported(module, set())):
        hasher.update(_hash_of_one(name))
    return hasher.hexdigest()


@cache
def _hash_of_one(module: str) -> bytes:
    return hashlib.sha256(repr(_plain(_code(module))).encode()).digest()


def _imported(module: str, known: set[str]) -> set[str]:
    """Add the name of a module, and of those that it imports."""
    if module not in known:
        known.add(module)
        for name in _names(_code(module)):
            if name.startswith(tuple(f"ibdata.{room}" for room in ROOMS)) and name in sys.modules:
                _imported(name, known)
    return known


@cache
def _code(module: str) -> CodeType:
    spec = sys.modules[module].__spec__
    return spec.loader.get_code(module)  # type: ignore[union-attr,no-any-return]  # a module of ibdata has source


def _names(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for value in code.co_consts:
        if isinstance(value, CodeType):
            yield from _names(value)


def _plain(code: CodeType) -> tuple[Any, ...]:
    """What code does, without its file and lines."""
    consts = tuple(map(_plain_constant, code.co_consts))
    return code.co_name, code.co_code, code.co_names, code.co_varnames, consts


def _plain_constant(value: Any) -> Any:
    if isinstance(value, CodeType):
        return _plain(value)
    return sorted(map(repr, value)) if isinstance(value, frozenset) else value  # which has no order


@cache
def _leave_scipy_out() -> None:
    """Keep numba from importing SciPy, which takes 0.2 s, only to learn that it is installed.

    Where linear algebra is compiled, numba imports SciPy as it always does.
    """
    if "numba.np.arraymath" in sys.modules or find_spec("scipy") is None:
        return
    from numba.np import linalg

    ensure_blas = linalg.ensure_blas
    linalg.ensure_blas = lambda: None
    try:
        from numba.np import arraymath

        vars(arraymath)["ensure_blas"] = ensure_blas
    finally:
        linalg.ensure_blas = ensure_blas


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


def uncompiled(function: Callable[..., object]) -> Path | None:
    """Where to count what a function does in plain Python; None if its code is kept, or never compiled."""
    name, folders = f"{function.__name__}-{_hash(function.__module__)[:16]}", cache_folders().folders
    # which finds nothing in a folder of another user, where pathlib raises
    is_kept = any(
        glob.glob(os.path.join(glob.escape(folder), "numba", f"{name}.*.nbc")) for folder in folders
    )
    return (
        Path(folders[-1], f"{name}.rows")
        if isinstance(function, Dispatcher) and folders and not is_kept
        else None
    )


def interpret() -> None:
    """Run compiled functions as plain Python from now on, also in the processes that this one starts."""
    os.environ["NUMBA_DISABLE_JIT"] = "1"
    config.reload_config()
    for names in [vars(module) for name, module in sys.modules.items() if name.startswith("ibdata.")]:
        names |= {name: made.py_func for name, made in names.items() if isinstance(made, Dispatcher)}


def _compiled(function: F, inline: bool = False) -> F:
    options: Any = {"inline": "always" if inline else "never", "no_cfunc_wrapper": True}
    made: Any = numba.njit(nogil=True, error_model="numpy", **options)(function)
    if made is not function and function.__module__.startswith("ibdata."):
        made._cache = CodeCache(function)  # what cache=True does with numba's own cache
    return cast(F, made)
