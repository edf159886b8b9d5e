"""Ranges of one dataset that are made at the same time: those that share shards exclude each other.

Each range holds a lock of its own. Whether ranges of other sizes hold theirs is looked at, and the own one
taken, behind a gate, through which one process goes at a time.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from ibdata.errors import BusyError
from ibdata.experiment.plan import Shard
from ibdata.generation import output_folder
from ibdata.generation.record import Range
from ibdata.system import lock

GATE = f"{output_folder.RANGE_LOCK}gate"
GATE_PATIENCE = 60.0  # seconds; hundreds of hosts may come at once, and each stays for milliseconds
NAME = re.compile(re.escape(output_folder.RANGE_LOCK) + "([1-9][0-9]{0,8})-([1-9][0-9]{0,8})")


@contextmanager
def locked(folder: Path, own: Range, shards: list[Shard]) -> Iterator[None]:
    """Hold a range of these shards; BusyError where one that has some of the same is being made."""
    with ExitStack() as stack:
        with lock.locked(folder, GATE, GATE_PATIENCE):
            refuse_shared(folder, own, shards)
            name = f"{output_folder.RANGE_LOCK}{own.part}-{own.parts}"
            stack.enter_context(lock.locked(folder, name))
        yield


def refuse_shared(folder: Path, own: Range, shards: list[Shard]) -> None:
    """BusyError where a range that has some of the same shards is being made; nothing is written."""
    mine = own.of(shards)
    for path in folder.glob(f"{output_folder.RANGE_LOCK}*"):
        found = NAME.fullmatch(path.name)
        other = Range(*map(int, found.groups())) if found else None
        if other and other.part <= other.parts and _meet(mine, other.of(shards)) and lock.held(path):
            raise BusyError(
                f"{folder}: found the range {other} being made, which has shards of {own} too; "
                "wait for it, or choose one that shares none with it"
            )


def _meet(a: list[Shard], b: list[Shard]) -> bool:
    """Whether two runs of consecutive shards have one in common."""
    return bool(a and b) and a[0].number <= b[-1].number and b[0].number <= a[-1].number
