"""One shard: simulate, write, and say what was written."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import Future, wait
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from threading import Lock
from typing import NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from ibdata.experiment import Experiment
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.simulation.rollout import Columns
from ibdata.simulation.variables import columns
from ibdata.system.atomic_files import TOKEN, FileEntry, HashingFile, atomic_write
from ibdata.writing.arrow import ROW_GROUP_ROWS, arrow_schema, arrow_table, writer_options
from ibdata.writing.summary import ShardSummarizer, ShardSummary, simulated
from ibdata.writing.threads import Threads


class WrittenShard(NamedTuple):
    """A shard that is on the disk."""

    shard: Shard
    entry: FileEntry
    content: ShardSummary


class ShardWriter:
    """A shard that is simulated, or made of these parts; then `finish` it or `abandon` it.

    A part is encoded and described in threads while the next is simulated; all let go of Python's lock.
    """

    def __init__(
        self,
        spec: DatasetSpec,
        shard: Shard,
        folder: Path,
        threads: Threads,
        made: Iterable[tuple[Shard, Columns]] | None = None,
    ) -> None:
        self.shard, self.experiment = shard, spec.of_shard(shard)
        self._account = ShardSummarizer(spec, shard)
        self._pending: list[Future[object]] = []
        self._encoding, self._stopped = Lock(), False
        made = simulated(spec, shard) if made is None else made
        with ExitStack() as stack:
            self._file = stack.enter_context(atomic_write(folder, file_of(shard)))
            self._groups = RowGroups(stack.enter_context(_writer(self.experiment, self._file)))
            stack.callback(self._stop)
            for part, own in made:
                self._settle([future for future in self._pending if future.done()])
                self._pending += threads.take(
                    partial(self._encode, part, own), partial(self._account.add, part, own)
                )
            self._opened = stack.pop_all()

    def _encode(self, part: Shard, floats: Columns) -> None:
        with self._encoding:
            if not self._stopped:  # what was queued when a signal came may be unknown to `_pending`
                self._groups.add(arrow_table(self.experiment, part, floats))

    def _settle(self, ended: list[Future[object]]) -> None:
        """Wait for these; what failed is raised."""
        for future in ended:
            future.result()
            self._pending.remove(future)

    def _stop(self) -> None:
        """Begin nothing more, and wait for what was begun."""
        with self._encoding:
            self._stopped = True
        for future in self._pending:
            future.cancel()
        wait(self._pending)

    def finish(self, last: Callable[[], None] = lambda: None) -> WrittenShard:
        """Commit the shard to its file, after a last look. Raises IbdataError where a value is not finite."""
        with self._opened:
            self._settle(list(self._pending))
            self._groups.end()
            content = self._account.content()
            last()
        entry = FileEntry(self._file.path, self._file.size, self._file.sha256())
        return WrittenShard(self.shard, entry, content)

    def abandon(self) -> None:
        """Leave nothing of it, whatever fails meanwhile."""
        with suppress(Exception), self._opened:
            raise InterruptedError


def file_of(shard: Shard) -> str:
    """The path of a shard's file, but for its token: a path from an old listing never opens other data."""
    return f"{shard.stem}-{TOKEN}.parquet"


class RowGroups:
    """Rows that come in tables of any length, and are written in groups of equal length."""

    def __init__(self, writer: pq.ParquetWriter) -> None:
        self._writer = writer
        self._rest: list[pa.Table] = []  # of fewer rows than a group

    def add(self, table: pa.Table) -> None:
        """Write the groups that are full."""
        rows = pa.concat_tables([*self._rest, table])
        whole = len(rows) - len(rows) % ROW_GROUP_ROWS
        for start in range(0, whole, ROW_GROUP_ROWS):
            self._write(rows.slice(start, ROW_GROUP_ROWS))
        self._rest = [rows.slice(whole)] if whole < len(rows) else []

    def end(self) -> None:
        """Write what is left."""
        for rows in self._rest:
            self._write(rows)

    def _write(self, rows: pa.Table) -> None:
        self._writer.write_table(rows.combine_chunks(), row_group_size=ROW_GROUP_ROWS)


def _writer(experiment: Experiment, file: HashingFile) -> pq.ParquetWriter:
    described = columns(experiment)
    return pq.ParquetWriter(file, arrow_schema(described), **writer_options(described))


def encode(experiment: Experiment, shard: Shard, floats: Columns, file: HashingFile) -> None:
    """Write a shard as Parquet."""
    with _writer(experiment, file) as writer:
        writer.write_table(arrow_table(experiment, shard, floats), row_group_size=ROW_GROUP_ROWS)
