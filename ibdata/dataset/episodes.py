"""A finished dataset, or some of its episodes: what it is, and which episodes are read."""

from __future__ import annotations

import copy
import os
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import pyarrow as pa

from ibdata._numerics.arguments import public
from ibdata._numerics.naming import counted, decimal
from ibdata._system.storage import Storage, existing
from ibdata.dataset.models import Statistic
from ibdata.dataset.returns import Returns, behaviour_returns
from ibdata.dataset.selection import (
    EpisodesArg,
    PolicyArg,
    ReturnsArg,
    SetpointArg,
    SplitArg,
    in_splits,
    meeting,
    within_returns,
)
from ibdata.dataset.splits import Splits, with_later
from ibdata.dataset.stored import Mask, Stored
from ibdata.dataset.tabular import ColumnStatistics, Described, Table, as_html
from ibdata.errors import DatasetError, IbdataError, UsageError, printable

if TYPE_CHECKING:
    import pandas as pd

Some = TypeVar("Some", bound="SomeEpisodes")
BLOCK_ROWS = 65_536

# What few look at, after what an episode is.
PLACED = ("cell", "index", "shard", "row_start", "row_stop", "digest")


class SomeEpisodes:
    """The episodes of a dataset, or some of them, and what is known of the dataset; see `Dataset`."""

    @public
    def __init__(self, path: str | os.PathLike[str] | Sequence[str | os.PathLike[str]]) -> None:
        self.mask: Mask | None = None  # whether each episode is one of these; None for all of them
        self.is_by_returns = False  # whether these were chosen by their returns
        self.chosen_split: SplitArg = None  # the split, or splits, that these are
        if isinstance(path, str | os.PathLike):
            self.stored = Stored.open(existing(path))
            return
        from ibdata.dataset.several import Several  # which most readers do without

        parts = [part if isinstance(part, SomeEpisodes) else SomeEpisodes(part) for part in path]
        if not parts:
            raise UsageError("path: found an empty list, expected at least one place")
        try:
            self.stored = Several([part.stored for part in parts]) if len(parts) > 1 else parts[0].stored
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            if isinstance(error, IbdataError):
                raise
            problem = "found metadata of one that do not fit each other; see ibdata validate"
            raise DatasetError(f"{', '.join(part.place for part in parts)}: {problem}") from None
        if any(part.mask is not None for part in parts):
            self.mask = np.concatenate([part.inside for part in parts])
        self.is_by_returns = any(part.is_by_returns for part in parts)

    def __repr__(self) -> str:
        of = "" if self.mask is None else "a selection of "
        size = f"{counted(len(self), 'row')}, {counted(int(self.inside.sum()), 'episode')}"
        return f"<ibdata.{type(self).__name__} {of}{printable(self.place)}: {size}>"

    def _repr_html_(self) -> str:
        episodes = self.episode_table
        row = {
            "dataset": self.stored.info.name,
            "rows": len(self),
            "episodes": len(episodes),
            "policies": episodes["policy"].unique().to_pylist(),
            "setpoints": [decimal(p) for p in episodes["setpoint"].unique().to_numpy()],
            "content root": f"{self.content_root[:12]}…",
            "in": self.place,
        }
        return as_html([Table(list(row), [list(row.values())]), *self.splits.tables()])

    def __fspath__(self) -> str:
        return str(self.storage.path)

    def __len__(self) -> int:
        if self.mask is None:
            return self.stored.manifest.rows
        return int(self.stored.episodes["length"].to_numpy()[self.mask].sum())

    @property
    def storage(self) -> Storage:
        """The files, by which it is a place: not of a selection, and not of what has been replaced since."""
        refuse_selection(self)
        self.stored.refuse_replaced()
        return self.stored.storage

    @property
    def path(self) -> Path:
        """The folder, from the root. Raises UsageError for a selection, and for a dataset at a URL."""
        refuse_selection(self)
        return self.stored.storage.path

    @property
    def place(self) -> str:
        """The folder of the dataset as it was given, or the URL without credentials."""
        return self.stored.name

    @property
    def content_root(self) -> str:
        """The hex SHA-256 of the dataset's content, which does not depend on files or encodings."""
        return self.stored.manifest.content_root

    @cached_property
    def info(self) -> Described:
        """meta/dataset.json: columns with roles, units and bounds; counts of the whole dataset."""
        return Described(self.stored.info.plain())

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """meta/manifest.json: experiments, shards, files with their SHA-256, content root, versions."""
        return self.stored.manifest.plain()

    @property
    def splits(self) -> Splits:
        """For each split its numbers of episodes and rows, and whether it is declared: of whole files."""
        keys = {"episodes", "rows", "declared"}
        return Splits({name: entry.model_dump(include=keys) for name, entry in self.stored.splits.items()})

    @property
    def inside(self) -> Mask:
        """Whether each episode of the whole dataset is one of these, (episodes,)."""
        return np.ones(len(self.stored.episodes), dtype=np.bool_) if self.mask is None else self.mask

    @property
    def episode_table(self) -> pa.Table:
        """The episodes as an Arrow table, without later splits."""
        table = self.stored.episodes
        return table if self.mask is None else table.filter(self.mask)

    @property
    @public
    def episodes(self) -> pd.DataFrame:
        """One row per episode: setpoint, policy, splits, length, return; cell, index, place of its rows."""
        table = with_later(self.stored.episodes, self.stored.splits)
        names = sorted(table.column_names, key=PLACED.__contains__)
        frame: pd.DataFrame = table.select(names).to_pandas(ignore_metadata=True)
        return frame if self.mask is None else frame[self.mask]

    @public
    def select(
        self: Some,
        split: SplitArg = None,
        *,
        setpoint: SetpointArg = None,
        policy: PolicyArg = None,
        episodes: EpisodesArg = None,
        returns: ReturnsArg = None,
    ) -> Some:
        """The episodes that meet all of these conditions.

        They are read as those of the dataset: `ds.select("train").arrays()`. Functions that take the rows of
        a dataset, such as `quality`, `importance` and `export`, take a selection too. It may be empty; only
        reading no rows is an error.

        Args:
            split: In this split, or in one of these.
            setpoint: At this setpoint, or at one of these; moving ones count by that in the experiment.
            policy: Of the policy with this label, or with one of these.
            episodes: With this number, or with one of these, such as range(100).
            returns: With an undiscounted return within (lowest, highest), both included; None for no limit.
                `importance`, `noise_floor` and `score_model` refuse episodes that were chosen by it.

        Raises:
            UsageError: The dataset has no such split, setpoint, policy or episode, or no limits are given.
        """
        if all(condition is None for condition in (split, setpoint, policy, episodes, returns)):
            return self
        whatever_return = self.inside & meeting(self.stored, split, setpoint, policy, episodes)
        selected = copy.copy(self)
        selected.mask = whatever_return & within_returns(self.stored, returns)
        is_whole = self.mask is None and all(x is None for x in (setpoint, policy, episodes, returns))
        selected.chosen_split = split if is_whole else None
        selected.is_by_returns = self.is_by_returns or not np.array_equal(selected.mask, whatever_return)
        return selected

    @public
    def returns(self) -> Returns:
        """The undiscounted returns of the behaviour, by policy and setpoint.

        Returns:
            `results`, a list of dicts with policy, setpoint, episodes, steps, mean_return, standard_error,
            interval, mean_reward (per step), reference (the returns that score 0 and 100), score and its
            standard error, score_error; and `scale`, the meaning of the scores. There are references for
            episodes of 1000 steps under a published variant, at the setpoints 0, 5 … 100, from the starts
            default, uniform and {burn_in: [15, 64]}. A single episode has no score.

        Raises:
            UsageError: The selection is empty.
            DatasetError: A file is missing or damaged.
        """
        return behaviour_returns(self._chosen().episode_table, self.stored.info)

    @public
    def statistics(self, split: SplitArg = None) -> ColumnStatistics:
        """Statistics of the float columns, which are read for all rows and for a declared split.

        Those of later splits and of other selections are computed from the rows; quantiles of more than
        50,000 rows are then those of a sample.

        Args:
            split: Only the rows of this split, or of these.

        Returns:
            For each column: count, mean, std, min, max, and quantiles by their probability, such as "0.5".

        Raises:
            UsageError: The dataset has no such split, or the selection is empty.
            DatasetError: A file is missing or damaged.
        """
        columns = self._chosen(split)._statistics()
        return ColumnStatistics((name, column.plain()) for name, column in columns.items())

    def _statistics(self) -> dict[str, Statistic]:
        stored, listed = self.stored, self.stored.statistics
        if self.mask is None and listed.all:
            return listed.all
        for name, of_split in listed.splits.items():
            if np.array_equal(self.inside, in_splits(stored, [name])):
                return of_split
        from ibdata.dataset.statistics import of_batches  # compiles, which other readers do without

        names = [column.name for column in stored.info.columns if column.dtype.startswith("float")]
        return of_batches(stored.batches_of(self.mask, names, BLOCK_ROWS), names, len(self))

    def _chosen(self: Some, split: SplitArg = None) -> Some:
        """The episodes of a split. Raises UsageError if there are none."""
        chosen = self.select(split)
        refuse_empty(chosen)
        return chosen


def refuse_empty(dataset: SomeEpisodes) -> None:
    """Raise UsageError if there is no episode in it."""
    if dataset.mask is not None and not dataset.mask.any():
        raise UsageError(
            "split, setpoint, policy, episodes, returns: found no episode that meets all, "
            "expected at least one"
        )


def refuse_by_returns(dataset: SomeEpisodes) -> None:
    """Raise UsageError if episodes were chosen by their returns, so that chance in them is not fair."""
    if dataset.is_by_returns:
        raise UsageError(
            "returns: found episodes that were chosen by their returns, expected all, whatever came of "
            "them: the chosen ones were lucky or unlucky; leave out returns"
        )


def refuse_selection(dataset: SomeEpisodes) -> None:
    """Raise UsageError if it is only some episodes of the dataset."""
    if dataset.mask is not None:
        raise UsageError(f"{dataset.place}: found a selection of its episodes, expected the whole dataset")
