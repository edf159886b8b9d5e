"""What lies in `data` and is not of the dataset, but would be taken by a reader of the folder."""

from __future__ import annotations

from collections.abc import Container, Iterator
from pathlib import Path

from ibdata.system import object_store


def strangers(folder: Path, known: Container[str]) -> Iterator[Path]:
    """The files and folders in `data` that are not among these paths and that a reader could take."""
    for name in object_store.files_in_data(folder):
        if name not in known and is_stranger(folder / name):
            yield folder / name


def is_stranger(path: Path) -> bool:
    """Whether a reader may take a file or folder of this name; polars and duckdb take hidden ones too."""
    hidden = path.name.startswith(".")
    return not hidden or path.name.lower().endswith(".parquet") or path.is_dir()
