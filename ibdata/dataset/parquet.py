"""Reading Parquet files that may be damaged, or no files at all: what is wrong with them is one line."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from ibdata.errors import DatasetError

UNREADABLE = (OSError, ValueError, KeyError, IndexError, pa.ArrowException)


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise DatasetError(f"{path}: found no regular file, expected one")
        yield
    except DatasetError:
        raise
    except UNREADABLE as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        line = (reason.splitlines() or [type(error).__name__])[0]
        raise DatasetError(f"{path}: cannot be read, see ibdata validate: {line}") from None


def read(path: Path, names: Sequence[str] | None = None) -> pa.Table:
    """A file's table, or just these columns of it; DatasetError where they cannot be read."""
    with _readable(path):
        columns = None if names is None else list(names)
        table = pq.read_table(_file(path), columns=columns, page_checksum_verification=True)
    _complete(path, table.column_names, names)
    return table


def batches(path: Path, names: Sequence[str], rows: int) -> Iterator[pa.RecordBatch]:
    """A file's rows in order, at most so many at a time. Raises as `read`."""
    with _readable(path), pq.ParquetFile(_file(path), page_checksum_verification=True) as file:
        _complete(path, file.schema_arrow.names, names)
        yield from file.iter_batches(rows, columns=list(names))


def _file(path: Path) -> pa.OSFile:
    """The file itself: given a path, pyarrow would find partitions in the names of its folders."""
    return pa.OSFile(os.fsencode(path))


def _complete(path: Path, found: list[str], names: Sequence[str] | None) -> None:
    missing = [name for name in names or () if name not in found]
    if missing:
        raise DatasetError(f"{path}: found no column {missing[0]}, expected one; see ibdata validate")
