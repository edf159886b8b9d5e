"""Reading rows as pandas, Arrow, batches or arrays: what a dataset and a selection have in common."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy.typing as npt
import pyarrow as pa

from ibdata.arguments import public
from ibdata.dataset.conditions import (
    Columns,
    Limits,
    Numbers,
    Policy,
    Setpoint,
    Split,
    checked_columns,
    checked_history,
    checked_length,
    refuse_columns,
)
from ibdata.dataset.returns import Returns, behaviour_returns
from ibdata.dataset.splits import with_later
from ibdata.dataset.stored import Stored
from ibdata.dataset.tabular import ColumnStatistics
from ibdata.dataset.transitions import as_batch, first_rows, left_out, needed, transitions
from ibdata.dataset.viewed import arrays_of, batches_of, windows_of
from ibdata.dataset.windows import Windows
from ibdata.errors import UsageError
from ibdata.views.options import View, view_of

if TYPE_CHECKING:
    import pandas as pd

    from ibdata.dataset.selection import Selection


class Readable(ABC):
    """What rows can be read from: a dataset, or a selection of one."""

    stored: Stored

    @property
    @abstractmethod
    def _everything(self) -> Selection:
        """All of its episodes."""

    @abstractmethod
    def __len__(self) -> int:
        """The number of rows."""

    @property
    def place(self) -> str:
        """The folder of the dataset as it was given, or the URL without credentials."""
        return self.stored.name

    @property
    def content_root(self) -> str:
        """The hex SHA-256 of the dataset's content, which does not depend on files or encodings."""
        return self.stored.manifest.content_root

    @cached_property
    def info(self) -> dict[str, Any]:
        """meta/dataset.json: columns with roles, units and bounds; counts of the whole dataset."""
        return self.stored.info.plain()

    @property
    def episodes(self) -> pd.DataFrame:
        """One row per episode: cell, index, setpoint, policy, splits, length, return, place of its rows."""
        mask, table = self.select().mask, with_later(self.stored.episodes, self.stored.splits)
        frame: pd.DataFrame = table.to_pandas(ignore_metadata=True)
        return frame if mask is None else frame[mask]

    @public
    def select(
        self,
        split: Split = None,
        *,
        setpoint: Setpoint = None,
        policy: Policy = None,
        episodes: Numbers = None,
        returns: Limits = None,
    ) -> Selection:
        """The episodes that meet all of these conditions.

        Rows of the selection are read as those of the dataset: `ds.select("train").arrays()`. Functions that
        take the rows of a dataset, such as `quality`, `importance` and `export`, take a selection too. It may
        be empty; only reading no rows is an error.

        Args:
            split: In this split, or in one of these.
            setpoint: At this setpoint, or at one of these; moving ones count by their first value.
            policy: Of the policy with this label, or with one of these.
            episodes: With this number, or with one of these, such as range(100).
            returns: With an undiscounted return within (lowest, highest), both included; None for no limit.
                `importance`, `noise_floor` and `score_model` refuse episodes that were chosen by it.

        Raises:
            UsageError: The dataset has no such split, setpoint, policy or episode, or no limits are given.
        """
        return self._everything.narrowed(split, setpoint, policy, episodes, returns)

    @public
    def returns(self) -> Returns:
        """The undiscounted returns of the behaviour, by policy and setpoint.

        Returns:
            `results`, a list of dicts with policy, setpoint, episodes, steps, mean_return, standard_error,
            interval, mean_reward (per step) and reference_score; and `scale`, the meaning of the scores.
            Scores exist for episodes of 1000 steps under a published variant, at the setpoints 0, 5 … 100,
            from the starts default, uniform and {burn_in: [15, 64]}; for others, the score is None.

        Raises:
            UsageError: The selection is empty.
            DatasetError: A file is missing or damaged.
        """
        return behaviour_returns(self._chosen().episode_table, self.stored.info)

    @public
    def table(
        self,
        columns: Columns = None,
        split: Split = None,
        *,
        setpoint: Setpoint = None,
        policy: Policy = None,
        view: View = None,
    ) -> pa.Table:
        """The rows as an Arrow table.

        Args:
            columns: The names of the columns to read; by default all.
            split: Only rows of this split, or of these.
            setpoint: Only rows at this setpoint, or at these; moving ones count by their first value.
            policy: Only rows of the policy with this label, or with these.
            view: The options of a view, a mapping of some of observe, actions, reward, reward_scale,
                imperfections and cost (docs/views.md). The columns are then episode, step, those of the
                frame, the actions, the reward, the cost, the flags, and `next_…` of the frame.

        Raises:
            UsageError: The dataset has no such column, split, setpoint or policy, or no episode that meets
                all conditions; or both columns and a view are given.
            DatasetError: A file is missing or damaged.
        """
        chosen = self._chosen(split, setpoint, policy)
        if view is None:
            return chosen.rows(checked_columns(columns, self.stored.info))
        refuse_columns(columns)
        info, options = self.stored.info, view_of(view)
        shown = transitions(chosen.rows(needed(info, options)), info, options)
        return pa.Table.from_batches([as_batch(shown, options.frame(info.drifting))])

    @public
    def to_pandas(
        self,
        columns: Columns = None,
        split: Split = None,
        *,
        setpoint: Setpoint = None,
        policy: Policy = None,
        view: View = None,
    ) -> pd.DataFrame:
        """The rows as a pandas DataFrame, whose index has their numbers in the dataset, from 0.

        Arguments and errors are those of `table`.
        """
        chosen = self._chosen(split, setpoint, policy)
        frame: pd.DataFrame = chosen.table(columns, view=view).to_pandas(ignore_metadata=True)
        if len(frame) < self.stored.manifest.rows:
            frame.index = chosen.row_numbers(left_out(self.stored.info, view_of(view)))
        return frame

    @public
    def head(
        self,
        rows: int = 5,
        columns: Columns = None,
        split: Split = None,
        *,
        at: tuple[int, int] | None = None,
    ) -> pa.Table:
        """The first rows as an Arrow table, read without the others.

        Args:
            rows: How many rows.
            columns: As in `table`.
            split: As in `table`.
            at: `(episode, step)` of the row of the dataset to begin at; by default the first one.

        Raises:
            UsageError: `rows` is below 1, or the dataset has no such column, split or row; or a row is given
                for a split or a selection.
            DatasetError: A file is missing or damaged.
        """
        rows = min(checked_length(rows, "rows"), self.stored.manifest.rows)
        chosen = self._chosen(split)
        if at is None:
            batches = chosen.iter_batches(columns, batch_rows=rows)
        elif chosen.mask is not None:
            raise UsageError("at: found a split or a selection too; leave one of them out")
        else:
            batches = self.stored.batches_from(at, checked_columns(columns, self.stored.info), rows)
        return first_rows(batches, rows)

    @public
    def iter_batches(
        self,
        columns: Columns = None,
        split: Split = None,
        batch_rows: int = 65_536,
        *,
        setpoint: Setpoint = None,
        policy: Policy = None,
        view: View = None,
    ) -> Iterator[pa.RecordBatch]:
        """The rows in order, at most `batch_rows` at a time, in constant memory.

        The other arguments and the errors are those of `table`.

        Raises UsageError if batch_rows is below 1.
        """
        batch_rows = min(checked_length(batch_rows, "batch_rows"), self.stored.manifest.rows)
        chosen = self._chosen(split, setpoint, policy)
        if view is None:
            return chosen.batches(checked_columns(columns, self.stored.info), batch_rows)
        refuse_columns(columns)
        options = view_of(view)
        frame = options.frame(self.stored.info.drifting)
        return batches_of(chosen.transitions(options, batch_rows), frame, batch_rows)

    @public
    def arrays(
        self,
        history: int = 1,
        split: Split = None,
        pad: str = "repeat",
        columns: Sequence[str] = (),
        *,
        setpoint: Setpoint = None,
        policy: Policy = None,
        view: View = None,
    ) -> dict[str, npt.NDArray[Any]]:
        """The rows as the arrays that learning libraries take.

        Args:
            history: How many frames to stack, newest first. A frame has the six observed variables, unless
                the view shows others.
            split: As in `table`.
            pad: For rows with fewer frames before them, "repeat" the first, or "drop" these rows.
            columns: Further columns of the dataset, such as action_log_prob and policy.
            setpoint: As in `table`.
            policy: As in `table`.
            view: The options of a view, as in `table`.

        Returns:
            observations and next_observations (N, 6 · history), actions (N, 3), rewards, terminated,
            truncated, episode and step (N,), and the further columns by name; costs (N,) if the view has a
            cost. If the view observes values that the dataset does not have after the last row of an episode,
            that row is left out.

        Raises:
            UsageError: An argument is invalid, or as in `table`.
            DatasetError: A file is missing or damaged.
        """
        drop, options = checked_history(history, pad), view_of(view)
        more = checked_columns(columns, self.stored.info) if len(columns) else []
        names = list(dict.fromkeys([*needed(self.stored.info, options), *more]))
        table = self._chosen(split, setpoint, policy).rows(names)
        return arrays_of(table, self.stored.info, options, history, drop, more)

    @public
    def windows(
        self,
        history: int = 1,
        split: Split = None,
        pad: str = "repeat",
        folder: str | os.PathLike[str] | None = None,
        *,
        setpoint: Setpoint = None,
        policy: Policy = None,
        view: View = None,
    ) -> Windows:
        """The rows as `arrays` gives them, in float32, but stacked only when they are asked for.

        For `torch.utils.data.DataLoader(windows, batch_size=256, shuffle=True, collate_fn=windows.collate)`.

        Args:
            history: As in `arrays`.
            split: As in `table`.
            pad: As in `arrays`.
            folder: A folder to keep the values in, which are then mapped and take no memory. It is made if it
                does not exist; if it holds the same windows, they are used.
            setpoint: As in `table`.
            policy: As in `table`.
            view: As in `table`.

        Raises:
            UsageError: As in `arrays`, or the folder holds something else.
            DatasetError: A file is missing or damaged.
        """
        drop, options = checked_history(history, pad), view_of(view)
        chosen = self._chosen(split, setpoint, policy)
        blocks = chosen.transitions(options)
        return windows_of(
            blocks, chosen.episode_table, self.stored.info, options, self.content_root, folder, history, drop
        )

    @public
    def statistics(self, split: Split = None) -> ColumnStatistics:
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
        columns = self._chosen(split).column_statistics()
        return ColumnStatistics((name, column.plain()) for name, column in columns.items())

    def _chosen(self, split: Split = None, setpoint: Setpoint = None, policy: Policy = None) -> Selection:
        """A selection that is not empty. Raises UsageError if none of its episodes meets all conditions."""
        chosen = self.select(split, setpoint=setpoint, policy=policy)
        chosen.refuse_empty()
        return chosen
