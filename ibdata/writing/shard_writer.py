"""Writing one shard to its file."""

from __future__ import annotations

import secrets
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple, ParamSpec, TypeVar

import pyarrow.parquet as pq

from ibdata.dataset.statistics import Moments
from ibdata.experiment import Experiment
from ibdata.experiment.columns import columns
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.experiment.rollout import Columns
from ibdata.system.files import FileEntry, HashingFile, new_file
from ibdata.system.signals import held
from ibdata.writing.arrow import ROW_GROUP_ROWS, arrow_schema, arrow_table, writer_options
from ibdata.writing.summary import ShardSummarizer, ShardSummary

WAITING = 2  # parts that may be in progress
P = ParamSpec("P")
T = TypeVar("T")


class WrittenShard(NamedTuple):
    """A shard, its file and a summary of its content."""

    shard: Shard
    entry: FileEntry
    content: ShardSummary


class Threads(NamedTuple):
    """The threads of a writer, which two writers may share."""

    encoding: Executor
    summarizing: Executor


class ShardWriter:
    """Writes a shard part by part: `add` each part in order, then `finish`.

    Open one with `shard_writer`. Each part is encoded in one thread and summarized in another while the
    caller makes the next part; encoding and summarizing release Python's lock.
    """

    def __init__(
        self,
        spec: DatasetSpec,
        shard: Shard,
        path: str,
        file: HashingFile,
        parquet: pq.ParquetWriter,
        threads: Threads,
    ) -> None:
        self._shard, self._experiment = shard, spec.of_shard(shard)
        self._path, self._file, self._parquet, self._threads = path, file, parquet, threads
        self._summarizer = ShardSummarizer(spec, shard)
        self._waiting: deque[tuple[Future[None], Future[Moments]]] = deque()

    def add(self, part: Shard, floats: Columns) -> None:
        """Hand over the next part. To bound memory, this waits while two parts are in progress.

        Args:
            part: The episodes of the part, which follow those of the part before.
            floats: Their float columns.

        Raises:
            OSError: An earlier part could not be written.
        """
        if len(self._waiting) == WAITING:
            self._wait()
        self._waiting.append(
            (
                self._threads.encoding.submit(self._encode, part, floats),
                self._threads.summarizing.submit(self._summarizer.add, part, floats),
            )
        )

    def finish(self) -> WrittenShard:
        """Wait for all parts. The file is on the disk at the end of the context of `shard_writer`.

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
        """Wait for the oldest part in progress, and raise its error if it failed."""
        for future in self._waiting.popleft():
            future.result()

    def _encode(self, part: Shard, floats: Columns) -> None:
        """Write the row groups of a part. None holds rows of two parts, so nothing is copied or kept."""
        self._parquet.write_table(arrow_table(self._experiment, part, floats), row_group_size=ROW_GROUP_ROWS)


@contextmanager
def shard_writer(spec: DatasetSpec, shard: Shard, folder: Path, threads: Threads) -> Iterator[ShardWriter]:
    """Write a shard of a dataset to a new file in its folder; a block that raises leaves nothing behind.

    The name of the file ends in random digits, so that a late reader never takes it for an older one.
    """
    path = f"{shard.stem}-{secrets.token_hex(4)}.parquet"
    with new_file(folder / path) as file, _parquet_writer(spec.of_shard(shard), file) as parquet:
        try:
            yield ShardWriter(spec, shard, path, file, parquet, threads)
        except BaseException:
            for each in threads:
                each.submit(int).result()  # wait for all that was submitted for this shard
            raise


@contextmanager
def writing_threads(overlap: bool = True) -> Iterator[Threads]:
    """Threads for `shard_writer`; without overlap the caller itself does what is submitted."""
    if not overlap:
        yield Threads(AtOnce(), AtOnce())
        return
    with thread() as encoding, thread() as summarizing:
        yield Threads(encoding, summarizing)


class AtOnce(Executor):
    """An executor that does at once what is submitted."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Call the function; its result or error is in the future."""
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except BaseException as error:
            future.set_exception(error)
        return future


@contextmanager
def thread() -> Iterator[ThreadPoolExecutor]:
    """An executor with one thread. The end of the block waits for all that was submitted."""
    executor = ThreadPoolExecutor(1)
    try:
        with held():  # a signal's exception while the thread starts would leave it running
            executor.submit(int).result()
        yield executor
    finally:
        executor.shutdown()


def _parquet_writer(experiment: Experiment, file: HashingFile) -> pq.ParquetWriter:
    described = columns(experiment)
    return pq.ParquetWriter(file, arrow_schema(described), **writer_options(described))


def encode(experiment: Experiment, shard: Shard, floats: Columns, file: HashingFile) -> None:
    """Write a whole shard as Parquet at once."""
    with _parquet_writer(experiment, file) as writer:
        writer.write_table(arrow_table(experiment, shard, floats), row_group_size=ROW_GROUP_ROWS)
