"""The files of a finished dataset, read as its manifest lists them."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from itertools import chain, groupby
from operator import itemgetter
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ibdata._numerics.ranges import joined
from ibdata._system.storage import Storage, storage
from ibdata.dataset import manifest, parquet
from ibdata.dataset.models import (
    Info,
    Manifest,
    Parsed,
    ShardEntry,
    SplitEntry,
    SplitsFile,
    Statistics,
    parse,
)
from ibdata.dataset.splits import refuse_misfits
from ibdata.errors import BusyError, DatasetError, UsageError, excerpt, reason

Mask = npt.NDArray[np.bool_]  # whether each episode of a dataset is one of some
Runs = list[tuple[int, int]]
INFO_PATH = "meta/dataset.json"
STATISTICS_PATH = "meta/statistics.json"
EPISODES_PATH = "meta/episodes.table"  # Parquet, which no reader of DIR/**/*.parquet takes for rows
_EPISODE_SCHEMA = pa.schema(
    [
        ("episode", pa.int64()),
        ("cell", pa.dictionary(pa.int32(), pa.string())),
        ("index", pa.int64()),
        ("setpoint", pa.float32()),  # or float64
        ("policy", pa.dictionary(pa.int32(), pa.string())),
        ("acting", pa.dictionary(pa.int32(), pa.string())),  # of a mixture, the policy drawn for the episode
        ("splits", pa.list_(pa.string())),
        ("length", pa.int64()),
        ("return", pa.float64()),
        ("shard", pa.int32()),
        ("row_start", pa.int64()),
        ("row_stop", pa.int64()),
        ("digest", pa.binary(32)),
    ]
)


def episode_schema(dtype: str) -> pa.Schema:
    """The columns of the table of episodes, whose setpoints have this type."""
    return _EPISODE_SCHEMA.set(3, pa.field("setpoint", pa.type_for_alias(dtype)))


class Stored:
    """A finished dataset at a place: its manifest, and the files that this lists.

    What was read is kept, so a dataset that was written to is opened anew. All methods raise DatasetError if
    a file is missing or damaged, and BusyError if that is because the dataset has been replaced.
    """

    def __init__(self, storage: Storage, manifest: Manifest) -> None:
        self.storage, self.manifest = storage, manifest
        self._splits: tuple[Any, dict[str, SplitEntry]] | None = None

    @classmethod
    def open(cls, place: Any) -> Stored:
        """The dataset in a folder or at a URL. Raises DatasetError if there is none, or it is damaged."""
        files = storage(place)
        return cls(files, manifest.read(files))

    @property
    def name(self) -> str:
        """The place, as it is named in messages."""
        return self.storage.name

    def read(self, path: str) -> bytes:
        """The bytes of a listed file, whose SHA-256 is that of the manifest."""
        data = self._bytes(path)
        expected = next((file.sha256 for file in self.manifest.files if file.path == path), None)
        if hashlib.sha256(data).hexdigest() != expected:
            raise self.error(path, "found other content than the manifest lists")
        return data

    def json(self, path: str, form: type[Parsed]) -> Parsed:
        """A listed JSON file as a model."""
        data = self.read(path)
        try:
            return parse(form, manifest.loads(data))
        except ValueError as error:
            raise self.storage.error(path, str(error)) from None

    def error(self, path: str, problem: str) -> DatasetError:
        """The error that names a problem of a file and its remedy.

        Raises BusyError instead if the dataset has been replaced.
        """
        self.refuse_replaced()
        remedy = f"; run ibdata repair {self.name}" if os.path.isdir(self.name) else ""
        return self.storage.error(path, f"{problem}{remedy}")

    def refuse_replaced(self) -> None:
        """Raise BusyError if the dataset at this place no longer has this manifest."""
        try:
            checksum = manifest.read(self.storage).checksum
        except DatasetError:
            return
        if checksum != self.manifest.checksum:
            raise BusyError(f"{self.name}: replaced while it was read; open it again")

    @cached_property
    def info(self) -> Info:
        """meta/dataset.json: columns with roles, units and bounds; counts."""
        return self.json(INFO_PATH, Info)

    @cached_property
    def statistics(self) -> Statistics:
        """meta/statistics.json: those of all rows and of the declared splits."""
        return self.json(STATISTICS_PATH, Statistics)

    @cached_property
    def episodes(self) -> pa.Table:
        """meta/episodes.table: a row for each episode; of the splits, the declared ones."""
        data, episodes = self.read(EPISODES_PATH), self.manifest.shards[-1].episodes[1]
        table = parquet.read(self.storage, EPISODES_PATH, _EPISODE_SCHEMA.names, rows=episodes, data=data)
        known = table.schema in map(episode_schema, ("float32", "float64"))
        if not known or any(column.null_count for column in table.columns):
            problem = "found other columns than ibdata writes; see ibdata validate"
            raise self.storage.error(EPISODES_PATH, problem)
        return table

    @property
    def splits(self) -> dict[str, SplitEntry]:
        """meta/splits.json: the splits by name. It is read again when the file is another than before."""
        stamp = self.storage.stamp(manifest.SPLITS)
        if self._splits is None or self._splits[0] != stamp:
            self._splits = stamp, self._read_splits()
        return self._splits[1]

    def _read_splits(self) -> dict[str, SplitEntry]:
        data = self._bytes(manifest.SPLITS)
        self.refuse_replaced()  # because the manifest does not list this file
        try:
            entries = parse(SplitsFile, manifest.loads(data)).root
            refuse_misfits(entries, self.manifest)
        except ValueError as error:
            raise self.error(manifest.SPLITS, str(error)) from None
        return entries

    def _bytes(self, path: str) -> bytes:
        try:
            return self.storage.read(path)
        except (FileNotFoundError, NotADirectoryError):
            problem = "missing"
        except OSError as error:
            problem = f"cannot be read: {reason(error)}"
        raise self.error(path, problem)

    def lost_shards(self) -> list[str]:
        """The paths of the shards of which there is no file; no file is read."""
        paths = [shard.path for shard in self.manifest.shards]
        if self.storage.url is None:
            return [path for path in paths if not os.path.isfile(self.storage.path / path)]
        return sorted({*paths} - {f"data/{name}" for name in self.storage.names("data")})

    def shard(self, number: int) -> ShardEntry:
        """A shard as the manifest lists it. Raises UsageError if there is no such number."""
        shards = self.manifest.shards
        if not 0 <= number < len(shards):
            raise UsageError(f"number: found {number}, expected a shard from 0 to {len(shards) - 1}")
        return shards[number]

    def rows(self, number: int, columns: Sequence[str] | None = None) -> pa.Table:
        """The rows of a shard."""
        shard = self.shard(number)
        with self._unreplaced():
            return parquet.read(self.storage, shard.path, self._types(columns), shard.rows)

    def batches(
        self, number: int, columns: Sequence[str], most: int, start: int = 0, stop: int | None = None
    ) -> Iterator[pa.RecordBatch]:
        """Rows start … stop - 1 of a shard in order, at most so many at a time."""
        shard, types = self.shard(number), self._types(columns)
        with self._unreplaced():
            yield from parquet.batches(self.storage, shard.path, types, most, shard.rows, start, stop)

    def batches_from(self, at: Sequence[int], columns: Sequence[str], most: int) -> Iterator[pa.RecordBatch]:
        """The rows from (episode, step) to the end. Raises UsageError at once if there is no such row."""
        episode, step = at if len(at) == 2 else (-1, 0)
        length = self.episodes["length"][episode].as_py() if 0 <= episode < len(self.episodes) else 0
        if not 0 <= step < length:
            steps = f", step 0 to {length - 1}" if length else ""
            last = len(self.episodes) - 1
            raise UsageError(f"at: found {excerpt(at)}, expected (episode, step): episode 0 to {last}{steps}")
        first = self.episodes["shard"][episode].as_py()
        row = self.episodes["row_start"][episode].as_py() + step
        numbers = range(first, len(self.manifest.shards))
        return chain.from_iterable(
            self.batches(number, columns, most, row if number == first else 0) for number in numbers
        )

    def rows_of(self, mask: Mask | None, columns: Sequence[str]) -> pa.Table:
        """These columns of all rows of the episodes in a mask, or of all."""
        parts: list[pa.Table] = []
        for number, runs in self._shards_of(mask):
            shard = self.rows(number, columns)
            parts.extend([shard] if runs is None else (shard.slice(a, b - a) for a, b in runs))
        return pa.concat_tables(parts).unify_dictionaries()

    def batches_of(self, mask: Mask | None, columns: Sequence[str], most: int) -> Iterator[pa.RecordBatch]:
        """The same rows in order, at most so many at a time."""
        shards = ((self.batches(number, columns, most), runs) for number, runs in self._shards_of(mask))
        return chain.from_iterable(_in_runs(batches, runs) for batches, runs in shards)

    def _shards_of(self, mask: Mask | None) -> list[tuple[int, Runs | None]]:
        """The numbers of the shards to read, each with the runs of rows to read, or None for all rows."""
        if mask is None:
            return [(number, None) for number in range(len(self.manifest.shards))]
        episodes = self.episodes.filter(mask)
        columns = (episodes[name].to_numpy().tolist() for name in ("row_start", "row_stop", "shard"))
        by_shard = groupby(joined(zip(*columns, strict=True)), itemgetter(2))
        return [(number, [(start, stop) for start, stop, _ in runs]) for number, runs in by_shard]

    def _types(self, columns: Sequence[str] | None) -> dict[str, str]:
        """The types of these columns, or of all."""
        types: dict[str, str] = {column.name: column.dtype for column in self.info.columns}
        return types if columns is None else {name: types.get(name, "none") for name in columns}

    @contextmanager
    def _unreplaced(self) -> Iterator[None]:
        """Raise BusyError if a file cannot be read because the dataset has been replaced."""
        try:
            yield
        except DatasetError:
            self.refuse_replaced()
            raise


def _in_runs(batches: Iterator[pa.RecordBatch], runs: Runs | None) -> Iterator[pa.RecordBatch]:
    """The rows of a shard that are in the runs, or all of them, from its batches in order."""
    first = 0
    for batch in batches:
        stop = first + batch.num_rows
        for start, end in [(first, stop)] if runs is None else runs:
            low, high = max(start, first), min(end, stop)
            if low < high:
                yield batch.slice(low - first, high - low)
        first = stop
