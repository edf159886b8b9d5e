"""Reading a finished dataset as pandas, Arrow, batches or arrays, without running any code of the dataset."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from itertools import chain
from numbers import Integral
from typing import TYPE_CHECKING, Any

import numpy.typing as npt
import pyarrow as pa

from ibdata.dataset import manifest, parquet
from ibdata.dataset.episodes import read_episodes
from ibdata.dataset.history import array_columns, arrays_of
from ibdata.dataset.models import Info, Manifest, Stats
from ibdata.dataset.overview import Splits, overview
from ibdata.dataset.returns import Returns, behaviour_returns
from ibdata.dataset.selection import Policy, Runs, Setpoint, known_of, rows_in, selected_runs
from ibdata.errors import DatasetError, UsageError
from ibdata.numerics.naming import counted
from ibdata.system import object_store

if TYPE_CHECKING:
    import pandas as pd

TRIES = 5


class Dataset:
    """A finished dataset in a folder or at a URL. Only files that its manifest lists are read.

    If the dataset is replaced after it was opened, reading raises ReplacedError. Files at a URL are copied to
    a temporary folder of this process when first needed. Functions that take a folder take a Dataset too.

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
        n = self.info_model.counts
        return f"<ibdata.Dataset {self.place}: {counted(n.rows, 'row')}, {counted(n.episodes, 'episode')}>"

    def _repr_html_(self) -> str:
        return overview(self)

    def __fspath__(self) -> str:
        return str(self.path)

    def __len__(self) -> int:
        return self.manifest_model.rows

    @property
    def content_root(self) -> str:
        """The hex SHA-256 that identifies the content; it does not depend on files or encodings."""
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

    @property
    def splits(self) -> Splits:
        """For each split its numbers of episodes and rows, and its files; None for files if it has none."""
        return Splits({name: split.plain() for name, split in self.info_model.splits.items()})

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
            episodes of 1000 steps under a published variant, at the setpoints 0, 5 … 100, from the starts
            default, uniform and {burn_in: [15, 64]}; for others, the score is None.
        """
        return behaviour_returns(self.episode_table, self.info_model)

    def table(
        self,
        columns: Sequence[str] | None = None,
        split: str | None = None,
        *,
        setpoint: Setpoint = None,
        policy: Policy = None,
    ) -> pa.Table:
        """The rows as an Arrow table.

        Args:
            columns: The names of the columns to read; by default all.
            split: Only rows of this split.
            setpoint: Only rows at this setpoint, or at these; moving ones count by their first value.
            policy: Only rows of the policy with this label, or with these.

        Raises:
            UsageError: The dataset has no such column, split, setpoint or policy.
            DatasetError: A file is missing or damaged.
        """
        names = self._columns(columns)
        parts = []
        for number, runs in self._shards(split, setpoint, policy):
            whole = self.read_shard(number, names)
            parts += [whole] if runs is None else [whole.slice(a, b - a) for a, b in runs]
        if not parts:  # the split has no episode at this setpoint, or of this policy
            return self.read_shard(0, names).slice(0, 0)
        return pa.concat_tables(parts).unify_dictionaries()

    def to_pandas(
        self,
        columns: Sequence[str] | None = None,
        split: str | None = None,
        *,
        setpoint: Setpoint = None,
        policy: Policy = None,
    ) -> pd.DataFrame:
        """The rows as a pandas DataFrame. Arguments and errors are those of `table`."""
        table = self.table(columns, split, setpoint=setpoint, policy=policy)
        frame: pd.DataFrame = table.to_pandas(ignore_metadata=True)
        return frame

    def iter_batches(
        self,
        columns: Sequence[str] | None = None,
        split: str | None = None,
        batch_rows: int = 65_536,
        *,
        setpoint: Setpoint = None,
        policy: Policy = None,
    ) -> Iterator[pa.RecordBatch]:
        """The rows in order, at most `batch_rows` at a time, in constant memory.

        The other arguments and the errors are those of `table`. Raises UsageError if batch_rows is below 1.
        """
        if batch_rows < 1:
            raise UsageError(f"batch_rows: found {batch_rows}, expected at least 1")
        names, shards = self._columns(columns), self._shards(split, setpoint, policy)
        parts = (rows_in(self.shard_batches(number, names, batch_rows), runs) for number, runs in shards)
        return chain.from_iterable(parts)

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
        self,
        history: int = 1,
        split: str | None = None,
        pad: str = "repeat",
        *,
        setpoint: Setpoint = None,
        policy: Policy = None,
    ) -> dict[str, npt.NDArray[Any]]:
        """The rows as the arrays that learning libraries take.

        Args:
            history: How many observations to stack, newest first.
            split: As in `table`.
            pad: For rows with fewer observations before them, "repeat" the first, or "drop" these rows.
            setpoint: As in `table`.
            policy: As in `table`.

        Returns:
            observations and next_observations (N, 6 · history), actions (N, 3), and rewards, terminated,
            truncated, episode and step (N,).

        Raises:
            UsageError: An argument is invalid, or the dataset has no such split, setpoint or policy.
            DatasetError: A file is missing or damaged.
        """
        if not isinstance(history, Integral) or history < 1:
            raise UsageError(f"history: found {history!r}, expected a whole number of at least 1")
        if pad not in ("repeat", "drop"):
            raise UsageError(f"pad: found {pad!r}, expected repeat or drop")
        table = self.table(array_columns(self.info_model.groups), split, setpoint=setpoint, policy=policy)
        return arrays_of(table, self.info_model.groups, history, pad == "drop")

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
        return known_of("column", columns, known)

    def _shards(self, split: str | None, setpoint: Setpoint, policy: Policy) -> list[tuple[int, Runs | None]]:
        """The numbers of the shards to read, each with the runs of rows to read, or None for all rows."""
        files = [shard.path for shard in self.manifest_model.shards]
        if split is not None:
            files = self.info_model.splits[self._known(split)].files or []
        if setpoint is None and policy is None and files:
            known = set(files)
            shards = enumerate(self.manifest_model.shards)
            return [(number, None) for number, shard in shards if shard.path in known]
        return sorted(selected_runs(self.episode_table, split, setpoint, policy).items())

    def _known(self, split: str) -> str:
        """Return the split. Raises UsageError if the dataset does not have it."""
        if not isinstance(split, str):
            raise UsageError(f"split: found {split!r}, expected the name of one split")
        if not self.splits:
            raise UsageError(f"split: found {split!r}, expected no split: the dataset declares no splits")
        return str(known_of("split", split, list(self.splits))[0])
