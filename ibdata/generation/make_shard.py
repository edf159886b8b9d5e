"""Making one shard: simulate it part by part, write its file, then its receipt."""

from __future__ import annotations

import threading
from pathlib import Path

from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.experiment.rollout import TableBuffer
from ibdata.generation import receipt
from ibdata.generation.worker import Tell
from ibdata.writing.shard_writer import shard_writer, writing_threads
from ibdata.writing.summary import simulated


class _Own(threading.local):
    """What a thread keeps from one shard to the next."""

    def __init__(self) -> None:
        self.memory = TableBuffer()


_own = _Own()


class Stopped(Exception):
    """Another thread asked to stop."""


def make_shard(
    spec: DatasetSpec,
    shard: Shard,
    root: Path,
    overlap: bool,
    stopped: threading.Event | None,
    tell: Tell,
) -> None:
    """Simulate a shard and write it, then its receipt.

    Args:
        spec: What the shard belongs to.
        shard: The shard.
        root: The part in which the dataset is made.
        overlap: Whether to encode and summarize a piece in threads while the next is simulated.
        stopped: Set by another thread to end the work early, or None.
        tell: Called after each piece of the shard.

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
        written = writer.finish()
    receipt.put(root, written)
