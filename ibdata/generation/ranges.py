"""Ranges of a dataset's shards. Hosts may make ranges at the same time if these have no shard in common.

Each range has a lock of its own. Before a process takes it, it looks at the locks of the other ranges.
Meanwhile it holds one more lock, the gate, which only one process can hold at a time. Notes tell which ranges
were begun.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

from ibdata.errors import BusyError, UsageError
from ibdata.experiment.plan import Shard
from ibdata.generation import output_folder, receipt
from ibdata.system import lock
from ibdata.system.atomic_files import write
from ibdata.writing.metadata import as_json

MAX_PARTS = 100_000
GATE_PATIENCE = 60.0  # seconds; hundreds of hosts may start at once, and each holds the gate for milliseconds


class Range(NamedTuple):
    """One of several equal parts of a dataset's shards, counted from 1."""

    part: int
    parts: int

    def __str__(self) -> str:
        return f"{self.part}/{self.parts}"

    @classmethod
    def parse(cls, text: str) -> Range:
        """Parse `i/n`. Raises UsageError for anything else."""
        part, slash, parts = text.partition("/")
        whole = slash and all(x.isascii() and x.isdigit() and len(x) < 10 for x in (part, parts))
        if not whole or not 1 <= int(part) <= int(parts) <= MAX_PARTS:
            raise UsageError(
                f"--shards: found {text!r}, expected i/n with i from 1 to n, such as 1/3, 2/3 and 3/3"
            )
        return cls(int(part), int(parts))

    def of(self, shards: list[Shard]) -> list[Shard]:
        """The consecutive shards of the range. The sizes of ranges differ by at most one shard."""
        n = len(shards)
        return shards[n * (self.part - 1) // self.parts : n * self.part // self.parts]


@contextmanager
def locked(folder: Path, own: Range, shards: list[Shard]) -> Iterator[None]:
    """Lock a range of these shards. Raises BusyError if a range with a common shard is being made."""
    with ExitStack() as stack:
        with lock.locked(folder, output_folder.GATE, GATE_PATIENCE):
            refuse_shared(folder, own, shards)
            name = f"{output_folder.RANGE_LOCK}{own.part}-{own.parts}"
            stack.enter_context(lock.locked(folder, name))
        yield


def refuse_shared(folder: Path, own: Range, shards: list[Shard]) -> None:
    """Raise BusyError if a range with a common shard is being made; write nothing."""
    mine = own.of(shards)
    for path in folder.glob(f"{output_folder.RANGE_LOCK}*"):
        found = output_folder.RANGE_LOCKS.fullmatch(path.name)
        other = Range(int(found[1]), int(found[2])) if found and found[1] else None
        if other and other.part <= other.parts and _meet(mine, other.of(shards)) and lock.held(path):
            raise BusyError(
                f"{folder}: the part {other} is being made, which has shards in common with the part {own}; "
                "wait for it, or choose a part without these shards"
            )


def _meet(a: list[Shard], b: list[Shard]) -> bool:
    """Whether two runs of consecutive shards have one in common."""
    return bool(a and b) and a[0].number <= b[-1].number and b[0].number <= a[-1].number


def note(root: Path, own: Range) -> None:
    """Note that a range was begun."""
    write(root, f"{receipt.FOLDER}/range-{own.part}-{own.parts}.json", as_json({"range": own}))


def noted(root: Path) -> list[Range]:
    """The ranges that were begun in a folder, from the names of their notes."""
    names = (path.name for path in (root / receipt.FOLDER).glob("range-*.json"))
    found = (re.fullmatch(r"range-([0-9]{1,6})-([0-9]{1,6})\.json", name) for name in names)
    return [Range(int(match[1]), int(match[2])) for match in found if match]
