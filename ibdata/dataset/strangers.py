"""What lies in `data` and is not of the dataset, but would be taken by a reader of the folder."""

from __future__ import annotations

from collections.abc import Container, Iterator
from typing import Any

from ibdata.system.storage import storage


def strangers(place: Any, known: Container[str]) -> Iterator[str]:
    """The paths in `data` that are not known and that a reader could take; those of folders end in /."""
    for name in storage(place).names("data"):
        if f"data/{name}".rstrip("/") not in known and is_stranger(name):
            yield f"data/{name}"


def is_stranger(name: str) -> bool:
    """Whether a reader may take a file of this name, or a folder; polars and duckdb take hidden ones too."""
    return not name.startswith(".") or name.lower().endswith((".parquet", "/"))
