"""What each range of an array job notes of its machine and its code, for whoever finishes the dataset."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

from ibdata.dataset import receipt
from ibdata.dataset.files import plain_bytes, write
from ibdata.dataset.metadata import as_json
from ibdata.errors import IbdataError, UsageError
from ibdata.experiment.plan import Shard

MAX_PARTS = 100_000
MAX_BYTES = 2**24  # of a note


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


def put(root: Path, own: Range, reproducible: bool, code: list[dict[str, str | None]]) -> None:
    """Note who makes a range; UsageError where others of the dataset were made by other code.

    That a machine had other bits is kept when another goes on.
    """
    found = get(root)
    if any(other["code"] != code for other in found.values()):
        raise UsageError(f"{root}: ranges were made by other code of the policies; choose another --out")
    right = reproducible and found.get(own, {"reproducible": True})["reproducible"]
    content = {"range": own, "reproducible": right, "code": code}
    write(root, f"{receipt.FOLDER}/range-{own.part}-{own.parts}.json", as_json(content))


def get(root: Path) -> dict[Range, dict[str, Any]]:
    """The notes of a folder's ranges; none where it was not made by an array job."""
    return dict(map(_note, (root / receipt.FOLDER).glob("range-*.json")))


def _note(path: Path) -> tuple[Range, dict[str, Any]]:
    """A range and what it noted; IbdataError where a file is no such note."""
    try:
        note = json.loads(plain_bytes(path, MAX_BYTES))
        own = Range.parse("/".join(map(str, note["range"])))
        whole = isinstance(note["reproducible"], bool) and isinstance(note["code"], list)
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        whole = False
    if not whole:
        raise IbdataError(
            f"{path}: found no note of a range, expected one; choose another --out, or start again with "
            "ibdata generate --overwrite"
        )
    return own, note


def same_bits(root: Path) -> bool:
    """Whether no machine that made a range computes other bits."""
    return all(note["reproducible"] for note in get(root).values())
