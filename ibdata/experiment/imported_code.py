"""Whether a module that this process has imported is what its file holds."""

from __future__ import annotations

import os
import struct
import sys
from contextlib import suppress
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import cache_from_source
from pathlib import Path
from types import CodeType
from typing import Any

from ibdata.errors import UsageError
from ibdata.experiment.imported_modules import Source
from ibdata.system.atomic_files import file_sha256

NOTE = "ibdata_sha256"  # an attribute of a module's spec


def noted_sha256(spec: ModuleSpec, path: Path) -> str | None:
    """Return the SHA-256 of a module's file when ibdata first saw the module, and note it with the module.

    None if the file had been edited since the module was imported, as far as its bytecode tells.
    """
    if NOTE not in vars(spec):
        vars(spec)[NOTE] = None if _is_newer_than_bytecode(path) else file_sha256(archive(path))
    noted: str | None = vars(spec)[NOTE]
    return noted


def archive(path: Path) -> Path:
    """The file of a module, or the zip file that holds it."""
    return next((folder for folder in path.parents if folder.is_file()), path)


def _is_newer_than_bytecode(path: Path) -> bool:
    """Whether a file is not the one of which Python has kept the bytecode, if it keeps bytecode."""
    kept = Path(cache_from_source(str(path)))
    if sys.dont_write_bytecode or not os.access(kept, os.W_OK):
        return False
    with suppress(OSError, struct.error):
        (flags, time, size), now = struct.unpack("<III", kept.read_bytes()[4:16]), path.stat()
        return flags == 0 and (time, size) != (int(now.st_mtime) % 2**32, now.st_size % 2**32)
    return False


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
