"""Validation finds changes of the footers of Parquet files, by a forger who corrects all hashes."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from helpers.datasets import AS_WRITTEN
from helpers.forging import seal

from ibdata.dataset import parquet
from ibdata.dataset.thrift import struct
from ibdata.validation.pages import wrong_pages
from ibdata.validation.validate import validate
from ibdata.writing.metadata import as_json


def patched(data: bytes, old: bytes, new: bytes) -> bytes:
    """A Parquet file with other bytes in its footer."""
    start = len(data) - 8 - int.from_bytes(data[-8:-4], "little")
    assert old in data[start:-8]
    footer = data[start:-8].replace(old, new)
    return data[:start] + footer + len(footer).to_bytes(4, "little") + data[-4:]


def with_other_schema(table: pa.Table, path: Path) -> None:
    """A file whose Arrow schema, which not every reader takes, has another type in one column."""
    other = table.schema.set(3, pa.field("obs_velocity", pa.int32(), nullable=False))
    with pq.ParquetWriter(path, table.schema, **AS_WRITTEN) as writer:
        writer.write_table(table)
        writer.add_key_value_metadata({"ARROW:schema": base64.b64encode(other.serialize())})


FOOTERS: dict[str, tuple[Callable[[pa.Table, Path], object], str]] = {
    "an order": (
        lambda table, path: pq.write_table(table, path, **AS_WRITTEN, sorting_columns=[pq.SortingColumn(11)]),
        "found an order of rows in row group 0",
    ),
    "a page index": (
        lambda table, path: pq.write_table(table, path, **AS_WRITTEN, write_page_index=True),
        "episode: found a page index in row group 0",
    ),
    "nullable": (
        lambda table, path: pq.write_table(
            table.cast(table.schema.set(3, table.schema.field(3).with_nullable(True))), path, **AS_WRITTEN
        ),
        "obs_velocity: found a column in which values may be missing",
    ),
    "another Arrow schema": (with_other_schema, "found another Arrow schema in the footer"),
}


def footer_of_a_forger(folder: Path, path: Path) -> list[str]:
    """What `validate` says of a file's footer after all hashes were made right again."""
    info = json.loads((folder / "meta/info.json").read_bytes())
    info["counts"]["data_bytes"] = sum(path.stat().st_size for path in (folder / "data").iterdir())
    (folder / "meta/info.json").write_bytes(as_json(info))
    seal(folder)
    problems = validate(folder)
    assert {(p.path, p.rule) for p in problems} <= {(str(path.relative_to(folder)), "footer")}
    return [problem.message for problem in problems]


def test_statistics_of_all_columns_are_compared_and_may_be_there(copied):
    """Earlier versions wrote them."""
    path = next((copied / "data").iterdir())
    table = pq.read_table(path)
    pq.write_table(table, path, **{**AS_WRITTEN, "write_statistics": True})
    assert footer_of_a_forger(copied, path) == []
    reward = pq.ParquetFile(path).metadata.row_group(0).column(table.schema.names.index("reward")).statistics
    true, false = (np.float32(number).tobytes() for number in (reward.min, reward.max))
    path.write_bytes(patched(path.read_bytes(), true, false))
    (found,) = footer_of_a_forger(copied, path)
    assert found == "reward: the footer lists other extremes of row group 0 than its rows have"


@pytest.mark.parametrize(("write", "message"), FOOTERS.values(), ids=FOOTERS)
def test_a_footer_by_which_readers_may_skip_rows_is_named(copied, write, message):
    path = next((copied / "data").iterdir())
    write(pq.read_table(path), path)
    (found,) = footer_of_a_forger(copied, path)
    assert found.startswith(message)


@pytest.mark.parametrize("path", ["data", "meta/episodes.parquet"])
@pytest.mark.parametrize("fields", ["those of today", "those of old readers"])
def test_each_extreme_that_a_footer_lists_is_compared(copied, path, fields):
    """Statistics hold each extreme twice: fields 1 and 2 for old readers, 5 and 6 for those of today."""
    place = next((copied / "data").iterdir()) if path == "data" else copied / path
    kept = pq.ParquetFile(place).metadata.row_group(0).column(0).statistics
    low, high = (b"\x08" + x.to_bytes(8, "little") for x in (kept.min, kept.max))
    other = b"\x08" + (kept.max + 1).to_bytes(8, "little")
    numbers = [b"\x18", b"\x18"] if fields == "those of old readers" else [b"\x28", b"\x18"]
    old, new = (numbers[0] + x + numbers[1] + low for x in (high, other))
    place.write_bytes(patched(place.read_bytes(), old, new))
    (found,) = footer_of_a_forger(copied, place)
    assert found == "episode: the footer lists other extremes of row group 0 than its rows have"


def test_row_groups_that_the_file_does_not_count_are_named(copied):
    path = next((copied / "data").iterdir())
    table = pq.read_table(path)
    pq.write_table(pa.concat_tables([table, table]), path, row_group_size=len(table), **AS_WRITTEN)
    counts = (2 * 2 * len(table), 2 * len(table))  # as Thrift writes them: doubled, in two bytes of 7 bits
    rows = [bytes([0x16, n & 127 | 128, n >> 7, 0x19]) for n in counts]
    path.write_bytes(patched(path.read_bytes(), *rows))
    (found,) = footer_of_a_forger(copied, path)
    assert found.startswith("found row groups with more or less rows")


def varint(number: int) -> bytes:
    """A number as Thrift writes it: doubled, in bytes of 7 bits."""
    number, found = 2 * number, b""
    while number > 127:
        number, found = number >> 7, found + bytes([number & 127 | 128])
    return found + bytes([number])


def test_a_column_that_the_footer_places_elsewhere_is_named(copied):
    """Here its pages stand twice in the file; they could differ, and readers differ in how they find them."""
    path = next((copied / "data").iterdir())
    file = pq.ParquetFile(path)
    column = file.metadata.row_group(0).column(file.schema.names.index("reward"))
    start, data = column.data_page_offset, path.read_bytes()
    footer = len(data) - 8 - int.from_bytes(data[-8:-4], "little")
    pages = data[start : start + column.total_compressed_size]
    old, new = (b"\x26" + varint(place) for place in (start, footer))  # fields 7 and 9: the second next
    path.write_bytes(patched(data[:footer] + pages + data[footer:], old, new))
    (found,) = footer_of_a_forger(copied, path)
    assert found == "reward: found other pages in row group 0 than the footer says"


@pytest.mark.parametrize(("name", "field", "change"), [
    ("reward", 11, lambda meta: meta[9]),
    ("reward", 7, lambda meta: meta[7] - 1),
    ("reward", 5, lambda meta: meta[5] - 1),
    ("policy", 11, lambda meta: meta[9]),
    ("policy", 9, lambda meta: meta[11]),
], ids=["a dictionary", "fewer bytes", "fewer values", "no dictionary", "both are one"])  # fmt: skip
def test_pages_are_where_the_footer_says(copied, name, field, change):
    path = next((copied / "data").iterdir())
    groups = struct(parquet.footer(path))[4]
    with path.open("rb") as file:
        assert list(wrong_pages(file, groups)) == []
        meta = next(chunk[3] for chunk in groups[0][1] if chunk[3][3] == [name.encode()])
        meta[field] = change(meta)
        assert (
            next(wrong_pages(file, groups))
            == f"{name}: found other pages in row group 0 than the footer says"
        )


def test_bytes_that_belong_to_no_column_are_named(copied):
    path = next((copied / "data").iterdir())
    data = path.read_bytes()
    footer = len(data) - 8 - int.from_bytes(data[-8:-4], "little")
    path.write_bytes(data[:footer] + bytes(100) + data[footer:])
    (found,) = footer_of_a_forger(copied, path)
    assert found == f"found bytes that belong to no column, expected the footer at byte {footer}"
