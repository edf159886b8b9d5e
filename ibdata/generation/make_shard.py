"""Making one shard: simulate it part by part, write its file, then its receipt."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.generation import receipt
from ibdata.generation.origin import refuse_late_imports
from ibdata.simulation.rollout import Memory
from ibdata.writing.shard_writer import shard_writer, writing_threads
from ibdata.writing.summary import simulated

Tell = Callable[[int, int], object]  # called with the number of a shard and its rows that are made so far


class _Own(threading.local):
    """What a thread keeps from one shard to the next."""

    def __init__(self) -> None:
        self.memory = Memory()


_own = _Own()


class Stopped(Exception):
    """Another thread asked to stop."""


def make_shard(
    spec: DatasetSpec,
    shard: Shard,
    root: Path,
    tell: Tell,
    overlap: bool = True,
    stopped: threading.Event | None = None,
) -> None:
    """Simulate a shard and write it, then its receipt.

    Args:
        spec: What the shard belongs to.
        shard: The shard.
        root: The part in which the dataset is made.
        tell: Called after each piece of the shard.
        overlap: Whether to encode and summarize a piece in threads while the next is simulated.
        stopped: Set by another thread to end the work early.

    Raises:
        Stopped: `stopped` was set.
    """
    steps = spec.of_shard(shard).steps
    with (
        writing_threads(overlap) as threads,
        shard_writer(spec, shard, root / receipt.DATASET, threads) as writer,
    ):
        for piece, floats in simulated(spec, shard, None if overlap else _own.memory):
            if stopped is not None and stopped.is_set():
                raise Stopped
            writer.add(piece, floats)
            del floats  # so that it is not in memory beside the next
            tell(shard.number, (piece.stop - shard.first) * steps)
        refuse_late_imports(root, spec)
        written = writer.finish()
    receipt.put(root, written)
