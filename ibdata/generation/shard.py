"""Writing a shard in a run: its file, a summary of its rows, and its receipt.

A run goes on from the receipts of the shards that are finished, and makes the metadata from them. A receipt
holds the entry of the shard's file and the summary: arrays, one after the other.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pyarrow.parquet as pq

from ibdata._numerics.arrays import Floats
from ibdata._simulation.episodes import FloatTable
from ibdata._system.files import FileEntry, HashingFile
from ibdata._system.part import RECEIPTS
from ibdata._system.runs import Run
from ibdata._system.signals import held
from ibdata.dataset.statistics import Moments, RowStatistics, sums
from ibdata.errors import IbdataError
from ibdata.generation.pieces import ROW_GROUP_ROWS, Piece, arrow_schema, writer_options
from ibdata.plan.columns import columns, layout
from ibdata.plan.dataset_spec import DatasetSpec, Shard

WAITING = 2  # pieces that may be in progress
AT_ONCE = 16  # receipts that are read
MOST = 8  # numbers of shards in a message


class ShardSummary(NamedTuple):
    """A summary of a shard's content, which does not depend on its file."""

    digests: list[bytes]  # of the episodes
    returns: Floats  # of the episodes, undiscounted
    moments: Moments  # of the float columns
    sample: FloatTable  # of the float columns, for quantiles
    clipped: int

    @property
    def content(self) -> str:
        """The hex digest of the shard's content, from the digests of its episodes."""
        return hashlib.sha256(b"".join(self.digests)).hexdigest()


class WrittenShard(NamedTuple):
    """A shard, its file and a summary of its content."""

    shard: Shard
    entry: FileEntry
    summary: ShardSummary


class ShardSummarizer:
    """Summarizes a shard whose pieces are added in order."""

    def __init__(self, spec: DatasetSpec, shard: Shard) -> None:
        self.shard, self.experiment = shard, spec.experiments[shard.experiment]
        rows = (shard.stop - shard.first) * self.experiment.steps
        self._statistics = RowStatistics(rows, self.experiment.rows)
        self._digests: list[bytes] = []
        self._returns: list[Floats] = []
        self._clipped = 0

    def add(self, piece: Piece) -> Moments:
        """Add the next episodes of the shard; return the moments of their columns."""
        names, table, clipped = piece.floats
        self._digests += piece.digests()
        self._returns.append(sums(table[names.index("reward")], self.experiment.steps))
        self._clipped += clipped
        return self._statistics.add(table)

    def summary(self) -> ShardSummary:
        """The summary of all pieces. Raises IbdataError if a value is not finite."""
        moments = self._statistics.moments
        names = layout(self.experiment).names
        finite = moments.counts == moments.rows
        finite[names.index("action_log_prob")] = True  # a custom policy may not know its density
        if not finite.all():
            name = names[int(np.argmin(finite))]
            raise IbdataError(
                f"{self.shard.stem}: {name}: found a value that is not finite, expected finite numbers"
            )
        returns = np.concatenate(self._returns)
        return ShardSummary(self._digests, returns, moments, self._statistics.sample, self._clipped)


def write_shard(
    spec: DatasetSpec, shard: Shard, pieces: Iterable[Piece], run: Run, overlap: bool = True
) -> WrittenShard:
    """Write a shard of a dataset in a run; an error leaves nothing behind.

    Args:
        spec: The experiments and splits of the dataset.
        shard: The shard.
        pieces: Its pieces, in order.
        run: The run.
        overlap: Whether a piece is encoded and summarized in threads while the next one is made. Both release
            Python's lock.

    Raises:
        IbdataError: A value is not finite.
        OSError: The file could not be written.
    """
    described = columns(spec.experiments[shard.experiment])
    summarizer = ShardSummarizer(spec, shard)

    def write(file: HashingFile) -> ShardSummary:
        with pq.ParquetWriter(file, arrow_schema(described), **writer_options(described)) as parquet:

            def encode(piece: Piece) -> None:  # no row group holds rows of two pieces, so nothing is copied
                parquet.write_table(piece.arrow_table(), row_group_size=ROW_GROUP_ROWS)

            if overlap:
                _in_threads(pieces, encode, summarizer.add)
            else:
                for piece in pieces:
                    encode(piece)
                    summarizer.add(piece)
                    del piece  # so that it is not in memory beside the next
        return summarizer.summary()

    return WrittenShard(shard, *run.add(shard.stem, write))


def _in_threads(pieces: Iterable[Piece], *tasks: Callable[[Piece], object]) -> None:
    """Do each task with every piece, in a thread for each task. At most two pieces wait in memory."""
    waiting: deque[list[Future[object]]] = deque()
    with ExitStack() as stack:
        threads = [stack.enter_context(ThreadPoolExecutor(1)) for _ in tasks]
        with held():  # a signal's exception while a thread starts would leave it running
            for thread in threads:
                thread.submit(int).result()
        for piece in pieces:
            if len(waiting) == WAITING:
                for future in waiting.popleft():
                    future.result()
            waiting.append([thread.submit(task, piece) for thread, task in zip(threads, tasks, strict=True)])
            del piece
        for future in chain.from_iterable(waiting):
            future.result()


def write_receipt(run: Run, written: WrittenShard) -> None:
    """Write the receipt of a shard, whose file is in the run."""
    summary = written.summary
    known = {"file": list(written.entry), "rows": summary.moments.rows, "clipped": summary.clipped}
    arrays: list[npt.NDArray[Any]] = [
        np.frombuffer(json.dumps(known).encode(), np.uint8),
        np.frombuffer(b"".join(summary.digests), np.uint8).reshape(-1, 32),
        summary.returns,
        *summary.moments[1:],
        summary.sample,
    ]
    buffer = io.BytesIO()
    for array in arrays:
        np.save(buffer, array)
    run.write(_receipt_path(written.shard), buffer.getvalue())


def read_receipt(run: Run, shard: Shard) -> WrittenShard | None:
    """Read the receipt of a shard of a run; None if there is none that is as it was written."""
    lost: tuple[type[Exception], ...] = (*run.lost, ValueError, TypeError, LookupError, EOFError)
    try:
        file = io.BytesIO(run.read(_receipt_path(shard)))
        header, digests, returns, *arrays, sample = (np.load(file) for _ in range(9))
        known = json.loads(header.tobytes())
        entry = FileEntry(*known["file"])
        if not re.fullmatch(f"{re.escape(shard.stem)}-[0-9a-f]+[.]parquet", entry.path):
            return None  # that of another shard
        moments = Moments(known["rows"], *arrays)
        summary = ShardSummary(list(map(bytes, digests)), returns, moments, sample, known["clipped"])
    except lost:  # somebody else's, too
        return None
    return WrittenShard(shard, entry, summary)


def _receipt_path(shard: Shard) -> str:
    return f"{RECEIPTS}/{shard.number:05d}.npy"


def finished_shards(run: Run, shards: Sequence[Shard], closely: bool = False) -> list[WrittenShard]:
    """These shards, as far as their receipts are there and fit their files, `closely`, or their sizes."""
    receipts = {f"{RECEIPTS}/{name}" for name in run.receipts()}

    def read(shard: Shard) -> WrittenShard | None:
        written = read_receipt(run, shard) if _receipt_path(shard) in receipts else None
        return written if written is not None and run.has(written.entry, closely) else None

    with ThreadPoolExecutor(AT_ONCE) as threads:
        return [written for written in threads.map(read, shards) if written is not None]


def all_written(
    run: Run, shards: Sequence[Shard], place: str | Path, remedy: str, closely: bool = False
) -> list[WrittenShard]:
    """All these shards, from their receipts in a run.

    Raises IbdataError if the receipt of one cannot be read, or does not fit its file.
    """
    whole = finished_shards(run, shards, closely)
    if len(whole) < len(shards):
        known = {written.shard.number for written in whole}
        lost = [shard.stem for shard in shards if shard.number not in known]
        more = f" and {len(lost) - MOST} more" if len(lost) > MOST else ""
        count = f"{len(lost)} of {len(shards)} shards are missing or damaged"
        raise IbdataError(f"{place}: {count}: {', '.join(lost[:MOST])}{more}; {remedy}")
    return whole
