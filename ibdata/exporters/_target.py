"""Writing an export in a hidden part beside its target, from which it gets its name when it is complete."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

from ibdata.dataset import manifest
from ibdata.errors import IbdataError, UsageError, missing
from ibdata.exporters._own import is_export, is_folder_export
from ibdata.system import files, signals
from ibdata.system.part import locked_part, resolved


@contextmanager
def whole(target: Path, overwrite: bool = False) -> Iterator[Path]:
    """Yield a path to write to, which is renamed to the target if the block succeeds; else nothing is left.

    Raises:
        UsageError: The target exists, or may not be replaced, or lies within a dataset.
        BusyError: Another process exports to this target.
        IbdataError: The system refuses to write.
    """
    _refuse(target, overwrite)
    place = resolved(target)
    with locked_part(place, target) as part:
        if part.receipts:
            raise UsageError(f"{target}: an unfinished run of generate has this name; choose another --out")
        part.clear()
        export = part.folder / "export" / target.name  # a name of its own, because Minari looks at the folder
        export.parent.mkdir()
        try:
            yield export
        except MemoryError:
            raise IbdataError(f"{target}: out of memory; use a smaller --history, or --split") from None
        signals.check()  # HDF5 loses exceptions
        files.sync_all(export)
        _refuse(target, overwrite)
        _refuse_others(place, export)
        part.place(export)


def _refuse(target: Path, overwrite: bool) -> None:
    """Raise UsageError for a target that lies within a dataset, or exists and is not to be replaced."""
    manifest.refuse_inside(target)
    if os.path.lexists(target) and not overwrite:
        raise UsageError(
            f"{target}: exists already; choose another --out, or --overwrite to replace an export"
        )
    if os.path.exists(target / manifest.PATH):
        raise UsageError(f"{target}: is a dataset, which no export replaces; choose another --out")
    if (target / "data").is_dir() and not is_folder_export(target):
        raise UsageError(f"{target}: found no export of ibdata; move it away, or choose another --out")
    for file in (target, target / "arrays.parquet"):
        if file.is_file() and not is_export(file):
            raise UsageError(f"{file}: found no export of ibdata; move it away, or choose another --out")


def _refuse_others(place: Path, export: Path) -> None:
    """Raise UsageError if the folder to replace holds anything that the export does not have."""
    for path in place.rglob("*"):
        name = path.relative_to(place)
        if path.match("chunk-*/file-*.parquet") and is_export(path):
            continue  # of LeRobot's format, which numbers its files
        if not ((export / name).exists() or (path.is_file() and files.is_litter(name.name))):
            raise UsageError(f"{place}: found {name}, which is not of such an export; choose another --out")


def needed(module: str, format: str, extra: str, package: str | None = None) -> Any:
    """Import an optional library. Raises an error, which names its package, if it is not installed."""
    try:
        return import_module(module)
    except ImportError:
        raise missing(f"exporting to {format}", package or module, extra) from None
