"""Check the footer of a Parquet file, by which readers find and skip rows: it must be true, and as written.

The numbers are those of the fields in github.com/apache/parquet-format, parquet.thrift.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from ibdata.dataset import parquet
from ibdata.dataset.thrift import Struct, struct
from ibdata.validation.pages import wrong_pages

SCHEMA, ROWS, GROUPS, KEYS = 2, 3, 4, 5  # of the footer
CHUNKS, GROUP_ROWS, ORDER = 1, 3, 4  # of a row group
META = 3  # of a chunk, which holds a column of a row group
PATH, VALUES, STATISTICS = 3, 5, 12  # of its description
# What no file of ibdata's has.
OF_CHUNK = {1: "another file", 4: "a page index", 6: "a page index", 8: "encryption"}
OF_META = {8: "metadata", 10: "an index page", 14: "a Bloom filter", 17: "bounding boxes"}
KNOWN = range(1, 9)  # fields of statistics; readers pass over all others
NULLABLE, NAME, FIELD_ID = 3, 4, 9  # of a column in the schema, whose first entry is the file
ARROW = b"ARROW:schema"


def wrong_footer(path: Path, schema: pa.Schema, data: bytes | None = None) -> str | None:
    """Describe the first part of a footer that is wrong or that ibdata never writes.

    Raises the errors of `parquet.read`.

    Args:
        path: The file.
        schema: Its columns as ibdata writes them.
        data: The bytes of the file, if they were read already.
    """
    with parquet.opened(path, data) as file:
        try:
            found = struct(parquet.footer(path, data))
            with io.BytesIO(data) if data is not None else path.open("rb") as raw:
                every = chain(_wrong(found, schema, file), wrong_pages(raw, found[GROUPS]))
                return next(every, None)
        except (ValueError, TypeError, KeyError, IndexError, AttributeError) as error:
            return f"found a footer that is not valid ({type(error).__name__}: {error})"


def _wrong(found: Struct, schema: pa.Schema, file: pq.ParquetFile) -> Iterator[str]:
    expected = struct(parquet.footer(Path(), _written(schema.empty_table())))
    for own, right in zip(_columns(found), _columns(expected), strict=True):
        if own != right:
            same = own.get(NULLABLE) == right.get(NULLABLE)
            what = "another type of Parquet" if same else "a column in which values may be missing"
            yield f"{own[NAME].decode()}: found {what}, expected the column as ibdata writes it"
    if [key for key in found.get(KEYS, []) if key[1] != ARROW] or len(found.get(KEYS, [])) > 1:
        yield "found metadata of the file, expected no metadata"
    for key in found.get(KEYS, []):
        stored = pa.ipc.read_schema(pa.py_buffer(base64.b64decode(key[2])))
        if foreign_metadata(stored) or not _plain(stored).equals(_plain(schema)):
            yield "found another Arrow schema in the footer than the file has"
    if sum(group[GROUP_ROWS] for group in found[GROUPS]) != found[ROWS]:
        yield f"found row groups with more or less rows than the {found[ROWS]} of the file"
    names = [file.schema.column(i).path for i in range(len(file.schema))]
    for number, group in enumerate(found[GROUPS]):
        if ORDER in group:
            yield f"found an order of rows in row group {number}, expected no statement of an order"
        if [_name(chunk[META][PATH]) for chunk in group[CHUNKS]] != names:
            yield f"found other columns in row group {number} than the file has"
        yield from _of_columns(number, group, file)


def _of_columns(number: int, group: Struct, file: pq.ParquetFile) -> Iterator[str]:
    compared: dict[str, Struct] = {}
    for chunk in group[CHUNKS]:
        meta = chunk[META]
        name = _name(meta[PATH])
        flat = len(meta[PATH]) == 1
        for part, strange in ((chunk, OF_CHUNK), (meta, OF_META)):
            for key in strange.keys() & part.keys():
                yield f"{name}: found {strange[key]} in row group {number}, expected a column without it"
        if flat and meta[VALUES] != group[GROUP_ROWS]:
            yield f"{name}: found {meta[VALUES]} values in row group {number}, expected {group[GROUP_ROWS]}"
        if STATISTICS in meta and flat:  # of any column; earlier versions wrote those of all
            compared[name] = {key: value for key, value in meta[STATISTICS].items() if key in KNOWN}
    rows = file.read_row_group(number, columns=list(compared))
    right = struct(parquet.footer(Path(), _written(rows)))[GROUPS][0][CHUNKS] if compared else []
    for (name, own), chunk in zip(compared.items(), right, strict=True):
        if not own.items() <= chunk[META].get(STATISTICS, {}).items():
            yield f"{name}: the footer lists other extremes of row group {number} than its rows have"


def foreign_metadata(found: pa.Schema) -> str | None:
    """Describe metadata of a schema; ibdata writes none, because pandas would name columns by it."""
    own = [("the file", found.metadata), *((f"column {field.name}", field.metadata) for field in found)]
    where, keys = next(((where, keys) for where, keys in own if keys), ("", None))
    return f"found metadata {sorted(keys)[0]!r} of {where}, expected no metadata" if keys else None


def _written(rows: pa.Table) -> bytes:
    """A Parquet file with these rows, in one row group, and with statistics of all columns."""
    out = pa.BufferOutputStream()
    pq.write_table(rows, out, row_group_size=max(1, len(rows)), use_dictionary=False, compression="none")
    return out.getvalue().to_pybytes()  # type: ignore[no-any-return]


def _columns(footer: Struct) -> list[Struct]:
    return [{key: x for key, x in column.items() if key != FIELD_ID} for column in footer[SCHEMA][1:]]


def _plain(schema: pa.Schema) -> pa.Schema:
    """A schema with texts in place of dictionaries of texts."""
    return pa.schema(
        [f.with_type(f.type.value_type) if pa.types.is_dictionary(f.type) else f for f in schema]
    )


def _name(path: list[bytes]) -> str:
    return b".".join(path).decode()
