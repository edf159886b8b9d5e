"""Bytecode that Python keeps of a module, and that is not that of the module's file."""

from __future__ import annotations

from contextlib import suppress
from importlib.machinery import SourceFileLoader
from importlib.util import cache_from_source
from pathlib import Path
from types import CodeType
from typing import Any

from ibdata.errors import UsageError
from ibdata.experiment.imported_modules import Source


def drop_stale_bytecode(source: Source) -> bool:
    """Remove bytecode that is not that of its source; return whether there was such.

    Python itself only compares time and size of the source.
    """
    kept = Path(cache_from_source(str(source.path)))
    if not (source.path.suffix == ".py" and source.path.is_file() and kept.is_file()):
        return False
    loader = SourceFileLoader(source.module, str(source.path))
    with suppress(SyntaxError, ValueError, EOFError):
        code = loader.source_to_code(source.path.read_bytes(), source.path)
        if _is_equal(loader.get_code(source.module), code):
            return False
    try:
        kept.unlink(missing_ok=True)
    except OSError:
        raise UsageError(f"{kept}: holds other code than {source.path}; remove it") from None
    return True


def _is_equal(one: Any, other: Any) -> bool:
    """Whether two code objects, or constants in them, are equal; unlike Python's, NaN is equal to NaN."""
    if isinstance(one, CodeType) and isinstance(other, CodeType):
        constants, others = one.co_consts, other.co_consts
        without = one.replace(co_consts=()) == other.replace(co_consts=())
        return without and len(constants) == len(others) and all(map(_is_equal, constants, others))
    return repr(one) == repr(other) or (isinstance(one, frozenset) and one == other)
