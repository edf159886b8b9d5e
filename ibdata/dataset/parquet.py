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

READ_ERRORS = (OSError, ValueError, KeyError, IndexError, pa.ArrowException)


@contextmanager
def _readable(path: Path, data: bytes | None) -> Iterator[None]:
    try:
        if data is None and not stat.S_ISREG(os.stat(path).st_mode):
            found = "a folder" if path.is_dir() else "a special file"
            raise DatasetError(f"{path}: found {found}, expected a regular file; see ibdata validate")
        yield
    except DatasetError:
        raise
    except READ_ERRORS as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        line = (reason.splitlines() or [type(error).__name__])[0]
        raise DatasetError(f"{path}: cannot be read, see ibdata validate: {line}") from None


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
    with _opened(path, names, rows, data) as file:
        return file.read(columns=None if names is None else list(names))


def described(path: Path) -> tuple[pa.Schema, int]:
    """The schema and the number of rows of a file. Raises the errors of `read`."""
    with _opened(path, None, None) as file:
        return file.schema_arrow, file.metadata.num_rows


def wrong_statistics(path: Path, names: Sequence[str]) -> str | None:
    """Describe the first minimum or maximum in the footer that differs from its rows. Raises as `read`.

    Readers skip row groups by these numbers.

    Args:
        path: The file.
        names: The columns to look at, of numbers that are finite.
    """
    with _opened(path, names, None) as file:
        places = {file.schema_arrow.names[i]: i for i in range(len(file.schema_arrow.names))}
        for group in range(file.num_row_groups):
            rows, kept = file.read_row_group(group, columns=list(names)), file.metadata.row_group(group)
            for name in names:
                listed, values = kept.column(places[name]).statistics, rows[name].to_numpy()
                found = None if listed is None else (listed.min, listed.max, listed.null_count)
                if found is not None and found != (values.min(), values.max(), 0):
                    return f"{name}: the footer lists other extremes of row group {group} than its rows have"
    return None


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
    with _opened(path, names, rows) as file:
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
def _opened(
    path: Path, names: Sequence[str] | None, rows: int | None, data: bytes | None = None
) -> Iterator[pq.ParquetFile]:
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
            raise DatasetError(f"{path}: found {found} rows, expected {rows}; see ibdata validate")
        missing = [name for name in names or () if name not in file.schema_arrow.names]
        if missing:
            raise DatasetError(f"{path}: {missing[0]}: missing, expected a column; see ibdata validate")
        yield file


def _file(path: Path) -> pa.OSFile:
    """Open a file. From a path, pyarrow would take the names of folders for partitions."""
    return pa.OSFile(os.fsencode(path))
