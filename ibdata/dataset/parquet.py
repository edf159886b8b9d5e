"""Reading Parquet files that may be damaged or missing. Every error is a DatasetError of one line."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import accumulate

import pyarrow as pa
import pyarrow.parquet as pq

from ibdata._system.storage import Storage
from ibdata.errors import DatasetError, printable, reason

Names = Sequence[str] | Mapping[str, str]
READ_ERRORS = (OSError, ValueError, KeyError, IndexError, pa.ArrowException)


def read(
    files: Storage,
    path: str,
    names: Names | None = None,
    rows: int | None = None,
    data: bytes | None = None,
) -> pa.Table:
    """Read these columns, or all, of a file of a dataset.

    `names` may be a mapping to the types of the columns, as dataset.json spells them. `data` are the bytes of
    the file, if they were read already. Raises DatasetError if the file cannot be read, lacks a column, has
    one of another type, or has another number of rows than expected.
    """
    with opened(files, path, data, names, rows) as file:
        return file.read(columns=None if names is None else list(names))


def schema_and_rows(files: Storage, path: str) -> tuple[pa.Schema, int]:
    """The schema and the number of rows of a file. Raises the errors of `read`."""
    with opened(files, path) as file:
        return file.schema_arrow, file.metadata.num_rows


def batches(
    files: Storage,
    path: str,
    names: Names | None,
    most: int,
    rows: int | None = None,
    start: int = 0,
    stop: int | None = None,
    threads: bool = True,
) -> Iterator[pa.RecordBatch]:
    """Rows start … stop - 1 of a file in order, at most `most` at a time. Raises the errors of `read`.

    Without `threads` the caller's thread decodes each alone, which takes less of the processors' time.
    """
    with opened(files, path, None, names, rows) as file:
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
    files: Storage,
    path: str,
    data: bytes | None = None,
    names: Names | None = None,
    rows: int | None = None,
) -> Iterator[pq.ParquetFile]:
    """A context with an open file. Arguments and errors are those of `read`."""
    errors = READ_ERRORS if files.url is None else Exception  # a plug-in for URLs may raise anything
    try:
        with (
            files.open(path) if data is None else pa.BufferReader(data) as source,
            pq.ParquetFile(
                source,
                page_checksum_verification=True,
                # At a URL, a request for each row group in place of many small ones. It takes their bytes.
                pre_buffer=files.url is not None,
            ) as file,
        ):
            count = file.metadata.num_rows
            if rows is not None and count != rows:
                raise files.error(path, f"found {count} rows, expected {rows}; see ibdata validate")
            schema = file.schema_arrow
            for name in names or ():
                if name not in schema.names:
                    raise files.error(path, f"{name}: missing, expected a column; see ibdata validate")
                dtype = plain_type(schema.field(name).type)
                if isinstance(names, Mapping) and dtype != names[name]:
                    problem = f"{name}: found a column of {dtype}, expected {names[name]}"
                    raise files.error(path, f"{problem}; see ibdata validate")
            yield file
    except DatasetError:
        raise
    except errors as error:
        raise files.error(path, f"cannot be read, see ibdata validate: {reason(error)}") from None


def plain_type(kind: pa.DataType) -> str:
    """The type of a column as dataset.json spells it."""
    if pa.types.is_dictionary(kind):
        return "string"
    return {"float": "float32", "double": "float64"}.get(str(kind), printable(str(kind))[:60])
