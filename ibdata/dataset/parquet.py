"""Reading Parquet files that may be damaged or missing. Every error is a DatasetError of one line."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import accumulate
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from ibdata.errors import DatasetError
from ibdata.system.object_store import damaged

READ_ERRORS = (OSError, ValueError, KeyError, IndexError, pa.ArrowException)


@contextmanager
def _readable(path: Path, data: bytes | None) -> Iterator[None]:
    try:
        if data is None and not stat.S_ISREG(os.stat(path).st_mode):
            found = "a folder" if path.is_dir() else "a special file"
            raise damaged(path, f"found {found}, expected a regular file; see ibdata validate")
        yield
    except DatasetError:
        raise
    except READ_ERRORS as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        line = (reason.splitlines() or [type(error).__name__])[0]
        raise damaged(path, f"cannot be read, see ibdata validate: {line}") from None


def read(
    path: Path, names: Sequence[str] | None = None, rows: int | None = None, data: bytes | None = None
) -> pa.Table:
    """Read a table.

    Args:
        path: The file.
        names: The columns to read; by default all.
        rows: The expected number of rows. It is compared before anything is read, so that a small file
            cannot fill the memory.
        data: The bytes of the file, if they were read already.

    Raises:
        DatasetError: The file cannot be read, lacks a column, or has another number of rows.
    """
    with opened(path, data, names, rows) as file:
        return file.read(columns=None if names is None else list(names))


def described(path: Path) -> tuple[pa.Schema, int]:
    """The schema and the number of rows of a file. Raises the errors of `read`."""
    with opened(path) as file:
        return file.schema_arrow, file.metadata.num_rows


def batches(
    path: Path,
    names: Sequence[str] | None,
    most: int,
    rows: int | None = None,
    start: int = 0,
    stop: int | None = None,
    threads: bool = True,
) -> Iterator[pa.RecordBatch]:
    """Rows start … stop - 1 of a file in order, at most `most` at a time. Raises the errors of `read`.

    Without `threads` the caller's thread decodes each alone, which takes less of the processors' time.
    """
    with opened(path, None, names, rows) as file:
        sizes = [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)]
        ends = list(accumulate(sizes))
        stop = file.metadata.num_rows if stop is None else stop
        groups = [i for i, end in enumerate(ends) if end > start and end - sizes[i] < stop]
        row = ends[groups[0]] - sizes[groups[0]] if groups else 0
        columns = None if names is None else list(names)
        for group in groups:
            for batch in file.iter_batches(most, row_groups=[group], columns=columns, use_threads=threads):
                low, high = max(0, start - row), min(batch.num_rows, stop - row)
                if low < high:
                    yield batch.slice(low, high - low)
                row += batch.num_rows


@contextmanager
def opened(
    path: Path, data: bytes | None = None, names: Sequence[str] | None = None, rows: int | None = None
) -> Iterator[pq.ParquetFile]:
    """A context with an open file. Arguments and errors are those of `read`."""
    with (
        _readable(path, data),
        pq.ParquetFile(
            _file(path) if data is None else pa.BufferReader(data),
            page_checksum_verification=True,
            pre_buffer=False,  # it would keep the bytes of all that was read
        ) as file,
    ):
        found = file.metadata.num_rows
        if rows is not None and found != rows:
            raise damaged(path, f"found {found} rows, expected {rows}; see ibdata validate")
        missing = [name for name in names or () if name not in file.schema_arrow.names]
        if missing:
            raise damaged(path, f"{missing[0]}: missing, expected a column; see ibdata validate")
        yield file


def _file(path: Path) -> pa.OSFile:
    """Open a file. From a path, pyarrow would take the names of folders for partitions."""
    return pa.OSFile(os.fsencode(path))
