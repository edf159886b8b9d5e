"""Reading a finished dataset as pandas, Arrow, batches or arrays, without running any code of the dataset."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ibdata.dataset import manifest, parquet
from ibdata.dataset.episodes import read_episodes
from ibdata.dataset.history import stacked
from ibdata.dataset.models import Info, Manifest, Stats
from ibdata.dataset.returns import Returns, behaviour_returns
from ibdata.errors import DatasetError, UsageError, suggestion
from ibdata.numerics.naming import counted
from ibdata.system import object_store

if TYPE_CHECKING:
    import pandas as pd

Runs = list[tuple[int, int]]
TRIES = 5


class Dataset:
    """A finished dataset in a folder or at a URL. Only files that its manifest lists are read.

    If the dataset is replaced after it was opened, reading raises ReplacedError. Files at a URL are copied to
    a temporary folder when they are first needed; the folder is removed when the process ends.

    Args:
        path: The folder, or a URL such as s3://bucket/name.

    Attributes:
        path: The folder, or the temporary folder of a URL.
        place: The folder, or the URL without credentials, as a text.

    Raises:
        DatasetError: There is no finished dataset, or its manifest is damaged.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = object_store.local_copy(path)
        self.place = object_store.name_of(self.path)
        self.manifest_model: Manifest
        for _ in range(TRIES):  # until manifest and info are of one dataset
            self.manifest_model = manifest.read(self.path)
            try:
                self.info_model  # noqa: B018  # kept
            except manifest.ReplacedError:
                continue
            except DatasetError:
                pass  # `info` raises it again
            break

    def __repr__(self) -> str:
        counts = self.info_model.counts
        rows, episodes = counted(counts.rows, "row"), counted(counts.episodes, "episode")
        return f"<ibdata.Dataset {self.place}: {rows}, {episodes}>"

    def __len__(self) -> int:
        return self.manifest_model.rows

    @property
    def content_root(self) -> str:
        """The hex SHA-256 that names the content; it does not depend on files and encodings."""
        return self.manifest_model.content_root

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """meta/manifest.json: experiments, shards, files with their SHA-256, content root, versions."""
        return self.manifest_model.plain()

    @cached_property
    def info(self) -> dict[str, Any]:
        """meta/info.json: columns with roles, units and bounds; counts; splits."""
        return self.info_model.plain()

    @cached_property
    def info_model(self) -> Info:
        """`info` as a model."""
        return manifest.read_json(self.path, self.manifest_model, "meta/info.json", Info)

    def statistics(self, split: str | None = None) -> dict[str, Any]:
        """Statistics of the float columns.

        Args:
            split: Only the rows of this split; by default all rows.

        Returns:
            For each column: count, mean, std, min, max, and quantiles by their probability, such as "0.5".

        Raises:
            UsageError: The dataset has no such split.
            DatasetError: meta/stats.json is missing or damaged.
        """
        stats = manifest.read_json(self.path, self.manifest_model, "meta/stats.json", Stats)
        columns = stats.all if split is None else stats.splits[self._known(split)]
        return {name: column.plain() for name, column in columns.items()}

    @cached_property
    def episodes(self) -> pd.DataFrame:
        """One row per episode: cell, index, setpoint, policy, splits, length, return, place of its rows."""
        frame: pd.DataFrame = self.episode_table.to_pandas(ignore_metadata=True)
        return frame

    @property
    def digests(self) -> list[bytes]:
        """The content digest of each episode, in order."""
        digests: list[bytes] = self.episode_table["digest"].to_pylist()
        return digests

    def returns(self) -> Returns:
        """The undiscounted returns of the behaviour, by policy and setpoint.

        Returns:
            `results`, a list of dicts with policy, setpoint, episodes, mean_return, standard_error, interval,
            mean_reward (per step) and score; and `scale`, the meaning of the scores. Scores exist for
            episodes of 1000 steps from the default start, under a published variant and at constant
            setpoints; for others, score and scale are None.
        """
        return behaviour_returns(self.episode_table, self.info_model)

    def table(self, columns: Sequence[str] | None = None, split: str | None = None) -> pa.Table:
        """The rows as an Arrow table.

        Args:
            columns: The names of the columns to read; by default all.
            split: Only rows of this split.

        Raises:
            UsageError: The dataset has no such column or split.
            DatasetError: A file is missing or damaged.
        """
        names = self._columns(columns)
        parts = []
        for number, runs in self._shards(split):
            whole = self.read_shard(number, names)
            parts += [whole] if runs is None else [whole.slice(a, b - a) for a, b in runs]
        return pa.concat_tables(parts).unify_dictionaries()

    def to_pandas(self, columns: Sequence[str] | None = None, split: str | None = None) -> pd.DataFrame:
        """The rows as a pandas DataFrame. Arguments and errors are those of `table`."""
        frame: pd.DataFrame = self.table(columns, split).to_pandas(ignore_metadata=True)
        return frame

    def iter_batches(
        self, columns: Sequence[str] | None = None, split: str | None = None, batch_rows: int = 65_536
    ) -> Iterator[pa.RecordBatch]:
        """The rows in order, at most `batch_rows` at a time, in constant memory.

        The other arguments and the errors are those of `table`. Raises UsageError if batch_rows is below 1.
        """
        if batch_rows < 1:
            raise UsageError(f"batch_rows: found {batch_rows}, expected at least 1")
        return self._batches(self._shards(split), self._columns(columns), batch_rows)

    def read_shard(self, number: int, columns: Sequence[str] | None = None) -> pa.Table:
        """The rows of a shard, counted from 0, as an Arrow table. Raises DatasetError if it is damaged."""
        shard = self.manifest_model.shards[number]
        with self._unreplaced():
            return parquet.read(manifest.locate(self.path, shard.path), columns, shard.rows)

    def shard_batches(
        self, number: int, columns: Sequence[str], batch_rows: int, start: int = 0, stop: int | None = None
    ) -> Iterator[pa.RecordBatch]:
        """Rows start … stop - 1 of a shard, at most `batch_rows` at a time; else as `read_shard`."""
        shard = self.manifest_model.shards[number]
        place = manifest.locate(self.path, shard.path)
        with self._unreplaced():
            yield from parquet.batches(place, columns, batch_rows, shard.rows, start, stop)

    @contextmanager
    def _unreplaced(self) -> Iterator[None]:
        """Raise ReplacedError if a file cannot be read because the dataset has been replaced."""
        try:
            yield
        except DatasetError:
            manifest.refuse_replaced(self.path, self.manifest_model)
            raise

    def arrays(
        self, history: int = 1, split: str | None = None, pad: str = "repeat"
    ) -> dict[str, npt.NDArray[Any]]:
        """The rows as the arrays that learning libraries take.

        Args:
            history: How many observations to stack, newest first.
            split: Only rows of this split.
            pad: What is done with the first rows of an episode, which have fewer observations before them:
                "repeat" repeats the first recorded observation, "drop" leaves these rows out.

        Returns:
            observations and next_observations (N, 6 · history), of setpoint, velocity, gain, shift, fatigue
            and consumption; actions (N, 3); rewards (N,); terminated and truncated (N,) bool; episode and
            step (N,).

        Raises:
            UsageError: The history is below 1, the dataset has no such split, or pad is neither of the two.
            DatasetError: A file is missing or damaged.
        """
        if history < 1:
            raise UsageError(f"history: found {history}, expected at least 1")
        if pad not in ("repeat", "drop"):
            raise UsageError(f"pad: found {pad!r}, expected repeat or drop")
        groups = self.info_model.groups
        roles = ("observation", "action", "reward", "next_observation")
        names = ["episode", "step", "terminated", "truncated"]
        table = self.table([*names, *(name for role in roles for name in groups[role])], split)

        def stack(role: str) -> npt.NDArray[Any]:
            return np.stack([table[name].to_numpy() for name in groups[role]], axis=1)

        out = {name: table[name].to_numpy() for name in names}
        observations, after = stacked(stack("observation"), stack("next_observation"), out["step"], history)
        arrays = {
            "observations": observations,
            "actions": stack("action"),
            "rewards": table["reward"].to_numpy(),
            "next_observations": after,
            **out,
        }
        if pad == "drop" and history > 1:
            whole = out["step"] >= history - 1
            return {name: array[whole] for name, array in arrays.items()}
        return arrays

    @cached_property
    def episode_table(self) -> pa.Table:
        """`episodes` as an Arrow table."""
        return read_episodes(self.path, self.manifest_model)

    def _columns(self, columns: Sequence[str] | None) -> list[str]:
        known = [column.name for column in self.info_model.columns]
        if columns is None:
            return known
        if isinstance(columns, str) or not columns or len(set(columns)) < len(columns):
            raise UsageError(f"columns: found {columns!r}, expected a list of different names")
        unknown = [name for name in columns if name not in known]
        if unknown:
            near = suggestion(unknown[0], known)
            raise UsageError(f"column: found {unknown[0]!r}, expected one of {', '.join(known)}{near}")
        return list(columns)

    def _shards(self, split: str | None) -> list[tuple[int, Runs | None]]:
        """The numbers of the shards to read, each with the runs of rows to read, or None for all rows."""
        shards = self.manifest_model.shards
        if split is None:
            return [(number, None) for number in range(len(shards))]
        files = self.info_model.splits[self._known(split)].files
        if files is not None:
            known = set(files)
            return [(number, None) for number, shard in enumerate(shards) if shard.path in known]
        return sorted(self._runs(split).items())

    def _runs(self, split: str) -> dict[int, Runs]:
        """The rows of a split in each shard, as runs start … stop - 1."""
        import pyarrow.compute as pc  # takes 0.04 s, and generating does not need it

        table = self.episode_table
        offsets = table["splits"].combine_chunks().offsets.to_numpy()
        hits = np.concatenate([[0], np.cumsum(pc.equal(pc.list_flatten(table["splits"]), split).to_numpy())])
        inside = np.flatnonzero(hits[offsets[1:]] > hits[offsets[:-1]])
        runs: dict[int, Runs] = {}
        columns = (table[name].to_numpy()[inside].tolist() for name in ("shard", "row_start", "row_stop"))
        for shard, start, stop in zip(*columns, strict=True):
            own = runs.setdefault(shard, [])
            if own and own[-1][1] == start:
                start = own.pop()[0]
            own.append((start, stop))
        return runs

    def _batches(
        self, shards: list[tuple[int, Runs | None]], names: list[str], rows: int
    ) -> Iterator[pa.RecordBatch]:
        for number, runs in shards:
            first = 0
            for batch in self.shard_batches(number, names, rows):
                stop = first + batch.num_rows
                for start, end in [(first, stop)] if runs is None else runs:
                    low, high = max(start, first), min(end, stop)
                    if low < high:
                        yield batch.slice(low - first, high - low)
                first = stop

    def _known(self, split: str) -> str:
        """Return the split. Raises UsageError if the dataset does not have it."""
        splits = self.info_model.splits
        if split not in splits:
            known = f"one of {', '.join(splits)}" if splits else "none: the dataset declares no splits"
            raise UsageError(f"split: found {split!r}, expected {known}{suggestion(split, splits)}")
        return split
