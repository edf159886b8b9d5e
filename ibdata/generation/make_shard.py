"""Making one shard: simulate it part by part, write its file, then its receipt."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from ibdata.errors import Interrupted
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.generation import receipt
from ibdata.generation.origin import refuse_late_imports
from ibdata.generation.output_folder import refuse_moved
from ibdata.system.progress import Advance
from ibdata.writing.shard_writer import ShardWriter, Threads, WrittenShard, shard_writer, writing_threads
from ibdata.writing.summary import simulated

Tell = Callable[[int, int], object]  # called with the number of a shard and its rows that are made so far


def untold(number: int, rows: int) -> None:
    """A `Tell` that nobody listens to."""


class CountedParts:
    """Moves a bar by the parts of shards that are made at the same time, in any order."""

    def __init__(self, advance: Advance) -> None:
        self._advance, self._lock = advance, threading.Lock()
        self._rows: dict[int, int] = {}  # by the number of the shard, until it is done

    def tell(self, number: int, rows: int) -> None:
        """Move the bar to the rows of a shard; there are fewer than before if it was begun again."""
        with self._lock:
            self._advance(rows - self._rows.get(number, 0))
            self._rows[number] = rows

    def done(self, number: int, rows: int) -> None:
        """Move the bar to the end of a shard."""
        self.tell(number, rows)
        del self._rows[number]


def write_shard(
    spec: DatasetSpec,
    shard: Shard,
    root: Path,
    identity: str,
    overlap: bool = True,
    stopped: threading.Event | None = None,
    tell: Tell = untold,
) -> WrittenShard:
    """Simulate a shard and write it, then its receipt.

    Args:
        spec: What the shard belongs to.
        shard: The shard.
        root: Where its file goes.
        identity: Of the run, for the receipt.
        overlap: Whether to encode and summarize a part in threads while the next is simulated.
        stopped: Set by another thread to end the work early.
        tell: Called after each part.

    Raises:
        Interrupted: `stopped` was set.
    """
    with writing_threads(overlap) as threads, ExitStack() as opened:
        writer = filled(opened, spec, shard, root, threads, stopped, tell)
        return finish(writer, opened.pop_all(), root, identity)


def filled(
    opened: ExitStack,
    spec: DatasetSpec,
    shard: Shard,
    root: Path,
    threads: Threads,
    stopped: threading.Event | None = None,
    tell: Tell = untold,
) -> ShardWriter:
    """Open the writer of a shard, simulate the shard, and hand all its parts to the writer."""
    writer = opened.enter_context(shard_writer(spec, shard, root, threads))
    for part, floats in simulated(spec, shard):
        if stopped is not None and stopped.is_set():
            raise Interrupted(signal.SIGTERM)
        writer.add(part, floats)
        tell(shard.number, (part.stop - shard.first) * spec.of_shard(shard).steps)
    refuse_late_imports(root, spec)
    return writer


def finish(writer: ShardWriter, opened: ExitStack, root: Path, identity: str) -> WrittenShard:
    """Commit a shard to which all parts were added, then its receipt."""
    with opened:
        made = writer.finish()
        refuse_moved(root, identity)
    receipt.put(root, identity, made)
    return made
