"""Writing a shard: its file, a summary of its rows, and in the part of a run its receipt.

A run goes on from the receipts of the shards that are finished, and makes the metadata from them. A receipt
holds the entry of the shard's file and the summary: arrays, one after the other.
"""

from __future__ import annotations

import hashlib
import io
import json
import secrets
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pyarrow.parquet as pq

from ibdata.dataset.digest import episode_digests
from ibdata.dataset.statistics import Floats, Moments, RowStatistics, sums
from ibdata.errors import IbdataError
from ibdata.experiment import Experiment
from ibdata.experiment.columns import columns, layout
from ibdata.experiment.dataset_spec import DatasetSpec, Shard
from ibdata.simulation.variables import Table
from ibdata.system.files import FileEntry, HashingFile, file_sha256, new_file, read_sealed, sealed, write_new
from ibdata.system.part import RECEIPTS
from ibdata.system.signals import held
from ibdata.writing.columns import ROW_GROUP_ROWS, Piece, arrow_schema, writer_options

DATASET = "dataset"  # the folder of a run that holds the dataset
WAITING = 2  # pieces that may be in progress
MOST = 8  # numbers of shards in a message


class ShardSummary(NamedTuple):
    """A summary of a shard's content, which does not depend on its file."""

    digests: list[bytes]  # of the episodes
    returns: Floats  # of the episodes, undiscounted
    moments: Moments  # of the float columns
    sample: Table  # of the float columns, for quantiles
    clipped: int


# Stands for the content of a shard that was not read.
NONE = np.empty(0)
UNREAD = ShardSummary(
    [], NONE, Moments(0, NONE, NONE, NONE, NONE, np.empty(0, np.int64)), np.empty((0, 0)), 0
)


class WrittenShard(NamedTuple):
    """A shard, its file and a summary of its content."""

    shard: Shard
    entry: FileEntry
    content: ShardSummary


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
        steps, episodes = self.experiment.steps, piece.episodes
        self._digests += episode_digests(piece.digest_columns(), [steps] * (episodes.stop - episodes.first))
        self._returns.append(sums(table[names.index("reward")], steps))
        self._clipped += clipped
        return self._statistics.add(table)

    def content(self) -> ShardSummary:
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


def describe(spec: DatasetSpec, shard: Shard, pieces: Iterable[Piece]) -> ShardSummary:
    """Summarize a shard from its pieces. Raises IbdataError if a value is not finite."""
    summarizer = ShardSummarizer(spec, shard)
    for piece in pieces:
        summarizer.add(piece)
    return summarizer.content()


def content_of(digests: list[bytes]) -> str:
    """The hex digest of a shard's content, from the digests of its episodes."""
    return hashlib.sha256(b"".join(digests)).hexdigest()


class Threads(NamedTuple):
    """The threads of a writer: pieces are encoded in one and summarized in the other, each in order."""

    encoding: ThreadPoolExecutor
    summarizing: ThreadPoolExecutor


class ShardWriter:
    """Writes a shard piece by piece: `add` each in order, then `finish`. Open one with `shard_writer`."""

    def __init__(
        self,
        shard: Shard,
        path: str,
        file: HashingFile,
        parquet: pq.ParquetWriter,
        summarizer: ShardSummarizer,
        threads: Threads | None,
    ) -> None:
        self._shard, self._path, self._file, self._parquet = shard, path, file, parquet
        self._summarizer, self._threads = summarizer, threads
        self._waiting: deque[tuple[Future[None], Future[Moments]]] = deque()

    def add(self, piece: Piece) -> None:
        """Hand over the next piece. To bound memory, this waits while two are in progress.

        Raises:
            OSError: An earlier piece could not be written.
        """
        if self._threads is None:
            self._encode(piece)
            self._summarizer.add(piece)
            return
        if len(self._waiting) == WAITING:
            self._wait()
        encoded = self._threads.encoding.submit(self._encode, piece)
        self._waiting.append((encoded, self._threads.summarizing.submit(self._summarizer.add, piece)))

    def finish(self) -> WrittenShard:
        """Wait for all pieces. The file is on the disk at the end of the context of `shard_writer`.

        Raises:
            IbdataError: A value is not finite.
            OSError: The file could not be written.
        """
        while self._waiting:
            self._wait()
        self._parquet.close()
        entry = FileEntry(self._path, self._file.size, self._file.sha256())
        return WrittenShard(self._shard, entry, self._summarizer.content())

    def _wait(self) -> None:
        """Wait for the oldest piece in progress, and raise its error if it failed."""
        for future in self._waiting.popleft():
            future.result()

    def _encode(self, piece: Piece) -> None:
        """Write the row groups of a piece. None holds rows of two pieces, so nothing is copied or kept."""
        self._parquet.write_table(piece.arrow_table(), row_group_size=ROW_GROUP_ROWS)


@contextmanager
def shard_writer(
    spec: DatasetSpec, shard: Shard, folder: Path, overlap: bool = True
) -> Iterator[ShardWriter]:
    """Write a shard of a dataset to a new file in its folder; a block that raises leaves nothing behind.

    The name of the file ends in random digits, so that a late reader never takes it for an older one.

    Args:
        spec: The experiments and splits of the dataset.
        shard: The shard.
        folder: The folder of the dataset.
        overlap: Whether a piece is encoded and summarized in threads while the caller makes the next one.
            Both release Python's lock.
    """
    path = f"{shard.stem}-{secrets.token_hex(4)}.parquet"
    with (
        new_file(folder / path) as file,
        parquet_writer(spec.experiments[shard.experiment], file) as parquet,
        _threads() if overlap else nullcontext() as threads,
    ):
        yield ShardWriter(shard, path, file, parquet, ShardSummarizer(spec, shard), threads)


@contextmanager
def _threads() -> Iterator[Threads]:
    """Threads for a writer. The end of the block waits for all that was submitted."""
    threads = Threads(ThreadPoolExecutor(1), ThreadPoolExecutor(1))
    try:
        with held():  # a signal's exception while a thread starts would leave it running
            for thread in threads:
                thread.submit(int).result()
        yield threads
    finally:
        for thread in threads:
            thread.shutdown()


def parquet_writer(experiment: Experiment, file: HashingFile) -> pq.ParquetWriter:
    """A writer of Parquet for an experiment's columns."""
    described = columns(experiment)
    return pq.ParquetWriter(file, arrow_schema(described), **writer_options(described))


def write_receipt(root: Path, written: WrittenShard) -> None:
    """Write the receipt of a shard, whose file is on the disk, in the folder of a run."""
    summary = written.content
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
    path = _receipt_path(root, written.shard)
    path.parent.mkdir(exist_ok=True)
    temporary = root / f".tmp-{secrets.token_hex(6)}-{path.name}"  # hosts may have equal process ids
    write_new(root, temporary.name, sealed(buffer.getvalue()))
    temporary.replace(path)


def read_receipt(root: Path, shard: Shard) -> WrittenShard | None:
    """Read the receipt of a shard in the folder of a run; None if there is none that is as it was written."""
    try:
        file = io.BytesIO(read_sealed(_receipt_path(root, shard)))
    except OSError:
        return None
    header, digests, returns, *arrays, sample = (np.load(file) for _ in range(9))
    known = json.loads(header.tobytes())
    if not known["file"][0].startswith(shard.stem):  # that of another shard
        return None
    moments = Moments(known["rows"], *arrays)
    summary = ShardSummary(list(map(bytes, digests)), returns, moments, sample, known["clipped"])
    return WrittenShard(shard, FileEntry(*known["file"]), summary)


def _receipt_path(root: Path, shard: Shard) -> Path:
    return root / RECEIPTS / f"{shard.number:05d}.npy"


def is_whole(root: Path, written: WrittenShard) -> bool:
    """Whether the file of a shard is the one that its receipt says."""
    return file_sha256(root / DATASET / written.entry.path) == written.entry.sha256


def has_size(root: Path, written: WrittenShard) -> bool:
    """Whether the file of a shard has the size that its receipt says; of one that was just written."""
    path = root / DATASET / written.entry.path
    return path.is_file() and path.stat().st_size == written.entry.bytes


def all_written(
    root: Path,
    shards: Sequence[Shard],
    place: Path,
    remedy: str,
    is_right: Callable[[Path, WrittenShard], bool] = has_size,
) -> list[WrittenShard]:
    """All these shards, from their receipts in the folder of a run.

    Raises IbdataError if the receipt of one cannot be read, or does not fit its file.
    """
    receipts = [read_receipt(root, shard) for shard in shards]
    whole = [written for written in receipts if written is not None and is_right(root, written)]
    if len(whole) < len(shards):
        known = {written.shard.number for written in whole}
        lost = [str(shard.number) for shard in shards if shard.number not in known]
        more = f" and {len(lost) - MOST} more" if len(lost) > MOST else ""
        count = f"{len(lost)} of {len(shards)} shards are missing or damaged"
        raise IbdataError(f"{place}: {count}: {', '.join(lost[:MOST])}{more}; {remedy}")
    return whole
