"""Where an export is written: beside its target, under whose name it appears when it is whole."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

from ibdata.dataset.manifest import refuse_inside
from ibdata.errors import IbdataError, Interrupted, MissingError, UsageError
from ibdata.system import signals
from ibdata.system.atomic_files import TEMPORARY, sync_folder


@contextmanager
def whole(target: Path) -> Iterator[Path]:
    """A path to write to; it becomes the target when the block ends well, and nothing stays otherwise.

    Raises UsageError for a target that exists or lies within a dataset.
    """
    refuse(target)
    scratch = target.parent / f"{TEMPORARY}{secrets.token_hex(6)}-{target.name}"
    missing = [path for path in target.parents if not path.exists()]
    try:
        scratch.mkdir(parents=True)
        result = scratch / target.name
        yield result
        signals.check()
        _sync(result)
        refuse(target)
        result.rename(target)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
        for path in missing:
            if path.is_dir() and not any(path.iterdir()):
                path.rmdir()
    sync_folder(target.parent)


def refuse(target: Path) -> None:
    """UsageError for a target that may not be written."""
    if os.path.lexists(target):
        raise UsageError(f"{target}: exists already, expected nothing; choose another --out")
    refuse_inside(target)


@contextmanager
def stoppable(target: Path) -> Iterator[None]:
    """Signals as exceptions, so that what was written is removed; what the system refuses as one line."""
    try:
        with signals.stoppable():
            yield
    except Interrupted as error:
        raise Interrupted(error.signal_number, "nothing of the export is left behind") from None
    except OSError as error:
        raise IbdataError(f"{target}: cannot be written: {error.strerror or error}") from error
    except MemoryError:
        raise IbdataError(f"{target}: memory is too short; use a smaller --history") from None


def reserve(path: Path, size: int) -> None:
    """Make sure that there is room for so many bytes; OSError where there is not.

    HDF5 ends the process with a segmentation fault where a write fails, and nobody could tidy up after it.
    """
    with path.open("xb") as file:
        os.posix_fallocate(file.fileno(), 0, size)
    path.unlink()


def needed(module: str, format: str, extra: str, package: str | None = None) -> Any:
    """An optional library, of a package of that name or another; MissingError where it is not installed."""
    try:
        return import_module(module)
    except ImportError:
        raise MissingError(f"exporting to {format}", package or module, extra) from None


def differs(what: str) -> IbdataError:
    """The error that what was read back is not what was written."""
    return IbdataError(f"{what}: read back other values than were written; the disk or a library is at fault")


def _sync(result: Path) -> None:
    """Wait until a file, or all files of a folder, are on the disk."""
    for path in [result, *result.rglob("*")]:
        if path.is_dir():
            sync_folder(path)
        else:
            with path.open("rb") as file:
                os.fsync(file.fileno())
