"""Check where a Parquet file has its pages, so that all readers find the same values.

The numbers are those of the fields in github.com/apache/parquet-format, parquet.thrift.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import BinaryIO

from ibdata.dataset.parquet import TAIL
from ibdata.dataset.thrift import Struct, struct_and_size

CHUNKS, META = 1, 3
PATH, VALUES, BYTES, PAGES, DICTIONARY = (
    3,
    5,
    7,
    9,
    11,
)  # of the description of a chunk; the last two are places
KIND, PAGE_BYTES, DATA_PAGE, PAGE_VALUES = 1, 3, 5, 1  # of the header of a page
OF_DATA, OF_DICTIONARY = 0, 2  # kinds of pages
MAGIC = 4  # bytes at the beginning of a file: "PAR1"
HEADER = 4096  # bytes, more than a header has


def wrong_pages(file: BinaryIO, groups: list[Struct]) -> Iterator[str]:
    """Describe chunks and pages that do not follow one another, or that hold more or less than is said.

    Args:
        file: The Parquet file.
        groups: Its row groups, as its footer describes them.

    Raises:
        ValueError: The header of a page is not valid.
        LookupError: A number is missing.
    """
    place = MAGIC
    for number, group in enumerate(groups):
        for chunk in group[CHUNKS]:
            meta = chunk[META]
            if not _tiled(list(_pages(file, place, place + meta[BYTES])), meta, place):
                name = b".".join(meta[PATH]).decode()
                yield f"{name}: found other pages in row group {number} than the footer says"
                return
            place += meta[BYTES]
    end = file.seek(-TAIL, os.SEEK_END)
    if place != end - int.from_bytes(file.read(4), "little"):
        yield f"found bytes that belong to no column, expected the footer at byte {place}"


def _pages(file: BinaryIO, place: int, end: int) -> Iterator[tuple[int, Struct]]:
    """The places and the headers of pages that follow one another, and the place after the last one."""
    while place < end:
        file.seek(place)
        header, size = struct_and_size(file.read(HEADER))
        yield place, header
        place += size + header[PAGE_BYTES]
    yield place, {}


def _tiled(pages: list[tuple[int, Struct]], meta: Struct, place: int) -> bool:
    """Whether a chunk consists of its pages of data, after a dictionary if it has one."""
    *found, (end, _) = pages
    first = 1 if DICTIONARY in meta else 0  # the page of data to begin with
    kinds = [header[KIND] for _, header in found]
    return (
        kinds == [OF_DICTIONARY] * first + [OF_DATA] * (len(found) - first)
        and end == place + meta[BYTES]
        and meta.get(DICTIONARY, place) == place
        and meta[PAGES] == found[first][0]
        and meta[VALUES] == sum(header[DATA_PAGE][PAGE_VALUES] for _, header in found[first:])
    )
