"""Writing an export beside its target, and renaming it when it is complete."""

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
from ibdata.system import disk, signals
from ibdata.system.files import sync_folder

TEMPORARY = ".tmp-"


@contextmanager
def whole(target: Path) -> Iterator[Path]:
    """Yield a path to write to, which is renamed to the target if the block succeeds; else nothing is left.

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
    """Raise UsageError for a target that exists or lies within a dataset."""
    if os.path.lexists(target):
        raise UsageError(f"{target}: exists already; choose another --out")
    refuse_inside(target)


@contextmanager
def stoppable(target: Path) -> Iterator[None]:
    """Turn signals and errors of the system into errors of one line."""
    try:
        with signals.stoppable():
            yield
    except Interrupted as error:
        raise Interrupted(error.signal_number, "nothing of the export is left behind") from None
    except OSError as error:
        raise IbdataError(f"{target}: cannot be written: {error.strerror or error}") from error
    except MemoryError:
        raise IbdataError(f"{target}: out of memory; use a smaller --history") from None


def reserve(path: Path, size: int) -> None:
    """Raise OSError unless there is room for this number of bytes.

    If a write fails, HDF5 ends the process with a segmentation fault, after which nothing could be removed.
    """
    with path.open("xb") as file:
        disk.reserve(file.fileno(), size)
    path.unlink()


def needed(module: str, format: str, extra: str, package: str | None = None) -> Any:
    """Import an optional library. Raises MissingError, which names its package, if it is not installed."""
    try:
        return import_module(module)
    except ImportError:
        raise MissingError(f"exporting to {format}", package or module, extra) from None


def differs(what: str) -> IbdataError:
    """The error for an export whose values differ when they are read back."""
    return IbdataError(f"{what}: read back other values than were written; the disk or a library is at fault")


def _sync(result: Path) -> None:
    """Wait until a file, or all files of a folder, are on the disk."""
    for path in [result, *result.rglob("*")]:
        if path.is_dir():
            sync_folder(path)
        else:
            with path.open("rb") as file:
                disk.sync(file.fileno())
