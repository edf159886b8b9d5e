"""The rows of a dataset as its shards hold them: which shards a selection needs, and their rows in order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import pyarrow as pa

from ibdata.arguments import public
from ibdata.dataset import manifest, parquet
from ibdata.dataset.contents import Contents
from ibdata.dataset.models import ShardEntry
from ibdata.dataset.selection import Columns, Policy, Runs, Setpoint, Split, known_of, rows_of
from ibdata.errors import DatasetError, UsageError, excerpt


class Shards(Contents):
    """A finished dataset, with the rows of its shards."""

    @public
    def read_shard(self, number: int, columns: Columns = None) -> pa.Table:
        """The rows of a shard, counted from 0, as an Arrow table. Raises DatasetError if it is damaged."""
        shard = self._shard(number)
        with self._unreplaced():
            return parquet.read(self.storage, shard.path, self._types(columns), shard.rows)

    @public
    def shard_batches(
        self, number: int, columns: Sequence[str], batch_rows: int, start: int = 0, stop: int | None = None
    ) -> Iterator[pa.RecordBatch]:
        """Rows start … stop - 1 of a shard, at most `batch_rows` at a time; else as `read_shard`."""
        shard = self._shard(number)
        with self._unreplaced():
            types = self._types(columns)
            yield from parquet.batches(self.storage, shard.path, types, batch_rows, shard.rows, start, stop)

    def _types(self, columns: Columns) -> dict[str, str]:
        """The types of these columns, or of all."""
        types: dict[str, str] = {column.name: column.dtype for column in self.info_model.columns}
        return types if columns is None else {name: types.get(name, "none") for name in columns}

    def _shard(self, number: int) -> ShardEntry:
        shards = self.manifest_model.shards
        if not 0 <= number < len(shards):
            raise UsageError(f"number: found {number}, expected a shard from 0 to {len(shards) - 1}")
        return shards[number]

    @contextmanager
    def _unreplaced(self) -> Iterator[None]:
        """Raise BusyError if a file cannot be read because the dataset has been replaced."""
        try:
            yield
        except DatasetError:
            manifest.refuse_replaced(self.storage, self.manifest_model)
            raise

    def _place_of(self, at: tuple[int, int]) -> tuple[int, int]:
        """The shard of a row, and its number in it. Raises UsageError if there is none."""
        table = self.episode_table
        episode, step = at if len(at) == 2 else (-1, 0)
        length = table["length"][episode].as_py() if 0 <= episode < len(table) else 0
        if not length or not 0 <= step < length:
            steps = f", step 0 to {length - 1}" if length else ""
            raise UsageError(
                f"at: found {excerpt(at)}, expected (episode, step): episode 0 to {len(table) - 1}{steps}"
            )
        return table["shard"][episode].as_py(), table["row_start"][episode].as_py() + step

    def _batches_from(self, shard: int, row: int, names: list[str], most: int) -> Iterator[pa.RecordBatch]:
        """The rows from this one of a shard to the end of the dataset."""
        for number in range(shard, len(self.manifest_model.shards)):
            yield from self.shard_batches(number, names, most, row if number == shard else 0)

    def _columns(self, columns: Columns) -> list[str]:
        known = [column.name for column in self.info_model.columns]
        if columns is None:
            return known
        if not columns or len(set(columns)) < len(columns):
            raise UsageError(f"columns: found {columns!r}, expected a list of different names")
        return known_of("column", columns, known)

    def _shards(self, split: Split, setpoint: Setpoint, policy: Policy) -> list[tuple[int, Runs | None]]:
        """The numbers of the shards to read, each with the runs of rows to read, or None for all rows."""
        if setpoint is None and policy is None:
            shards = list(enumerate(self.manifest_model.shards))
            if split is None:
                return [(number, None) for number, _ in shards]
            if self.split_entry(split).declared:
                return [(number, None) for number, shard in shards if split in shard.splits]
        return sorted(rows_of(self.episode_table, self.selected(split, setpoint, policy)).items())
