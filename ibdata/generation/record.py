"""Which ranges of an array job were begun in a folder: what they are called, and whose shards are whose."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

from ibdata.errors import UsageError
from ibdata.experiment.plan import Shard
from ibdata.system.atomic_files import write
from ibdata.writing import receipt
from ibdata.writing.metadata import as_json

MAX_PARTS = 100_000


class Range(NamedTuple):
    """The part-th of so many parts of a dataset's shards, counted from 1."""

    part: int
    parts: int

    def __str__(self) -> str:
        return f"{self.part}/{self.parts}"

    @classmethod
    def parse(cls, text: str) -> Range:
        """That of `i/n`; UsageError for anything else."""
        part, slash, parts = text.partition("/")
        whole = slash and all(x.isascii() and x.isdigit() and len(x) < 10 for x in (part, parts))
        if not whole or not 1 <= int(part) <= int(parts) <= MAX_PARTS:
            raise UsageError(
                f"--shards: found {text!r}, expected i/n with i from 1 to n, such as 1/3, 2/3 and 3/3"
            )
        return cls(int(part), int(parts))

    def of(self, shards: list[Shard]) -> list[Shard]:
        """Its shards: consecutive ones, as many as the other parts have or one more or less."""
        n = len(shards)
        return shards[n * (self.part - 1) // self.parts : n * self.part // self.parts]


def put(root: Path, own: Range) -> None:
    """Note that a range was begun."""
    write(root, f"{receipt.FOLDER}/range-{own.part}-{own.parts}.json", as_json({"range": own}))


def get(root: Path) -> list[Range]:
    """The ranges that were begun in a folder, as the names of their notes say; none without an array job."""
    names = (path.name for path in (root / receipt.FOLDER).glob("range-*.json"))
    found = (re.fullmatch(r"range-([0-9]{1,6})-([0-9]{1,6})\.json", name) for name in names)
    return [Range(int(match[1]), int(match[2])) for match in found if match]
