"""A version of numba's cache of machine code that verifies each file before it loads it.

numba's own cache trusts every file that it finds, and fails on a file that it cannot read. This cache
compiles a function again if its file is missing, damaged or owned by another user. It relies on three details
of numba: the key, the serialized form of machine code, and that the compiler calls `load_overload` before it
compiles and `save_overload` afterwards.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from numba.core.caching import Cache, CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, _CacheLocator

from ibdata.errors import IbdataError
from ibdata.numerics.announcement import Announcement
from ibdata.system.cache_folders import Places
from ibdata.system.private_files import verified

ANNOUNCEMENT = Announcement()
_load = Cache.load_overload  # numba's own, also while `compile_others_anew` replaces it


class _Locator(_CacheLocator):
    """Identifies a function by its file and line. numba reads `_py_file` for a warning."""

    def __init__(self, function: Any, file: str) -> None:
        self._py_file, self._line = file, function.__code__.co_firstlineno

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _Locator:
        return cls(py_func, py_file)

    def get_cache_path(self) -> str:
        return os.path.dirname(os.path.abspath(self._py_file))

    def get_source_stamp(self) -> str:
        return _sha256_of(self._py_file)

    def get_disambiguator(self) -> str:
        return str(self._line)

    def ensure_cache_path(self) -> None:
        """Do nothing, because `Places` creates the folders."""


class _Impl(CompileResultCacheImpl):
    """Serializes machine code."""

    _locator_classes = [_Locator]  # noqa: RUF012  # declared like this in numba's base class


class _CodeFiles(IndexDataCacheFile):
    """One file per key, instead of numba's index and numbered files."""

    def __init__(self, impl: _Impl, places: Places) -> None:
        super().__init__(impl.locator.get_cache_path(), impl.filename_base, impl.locator.get_source_stamp())
        self._prefix, self._places = impl.filename_base, places

    def save(self, key: Any, data: Any) -> None:
        self._places.keep(self._name(key), self._dump((self._source_stamp, key, data)))

    def load(self, key: Any) -> Any:
        for folder in self._places.folders:
            with suppress(OSError), verified(folder, self._name(key)) as descriptor:
                stamp, found, data = self._load_data(descriptor)
                if (stamp, found) == (self._source_stamp, key):
                    return data
        return None

    def _data_path(self, name: int) -> int:
        """What numba opens: a descriptor of the verified file, so that no other file can take its place."""
        return os.dup(name)

    def _name(self, key: Any) -> str:
        address = hashlib.sha256(repr((self._cache_path, key)).encode()).hexdigest()[:16]
        return f"{self._prefix}.{address}.nbc"


class CodeCache(FunctionCache):
    """The cache of one compiled function."""

    _impl_class = _Impl

    def __init__(self, function: Callable[..., object], places: Places) -> None:
        super().__init__(function)
        self._places = places
        self._cache_file = _CodeFiles(self._impl, places)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The machine code for a signature, or None if it must be compiled."""
        _leave_scipy_out()
        found = None
        try:
            found = _load(self, sig, target_context)
        except IbdataError:  # raised by a signal handler
            raise
        except Exception:  # compile again, whatever the reason
            pass
        if found is None:
            ANNOUNCEMENT.begin(self._places)
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the machine code for a signature, which has been compiled since `load_overload`."""
        super().save_overload(sig, data)
        ANNOUNCEMENT.end()


def compile_others_anew(anew: bool) -> None:
    """Let numba load, or not load, what others than ibdata have compiled in earlier processes.

    numba only compares a function's own file, so machine code may hold an earlier version of another file,
    of which a number was compiled in or a function is called.
    """
    setattr(Cache, "load_overload", (lambda *_: None) if anew else _load)  # noqa: B010  # mypy refuses an assignment


@cache
def _sha256_of(file: str) -> str:
    return hashlib.sha256(Path(file).read_bytes()).hexdigest()


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
