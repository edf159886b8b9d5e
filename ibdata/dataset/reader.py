"""Reading a finished dataset as pandas, Arrow, batches or arrays, without running any code of the dataset."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ibdata.arguments import public
from ibdata.dataset import manifest
from ibdata.dataset.models import Statistics
from ibdata.dataset.selection import Columns, Policy, Setpoint, Split, rows_in
from ibdata.dataset.shards import Shards
from ibdata.dataset.transitions import (
    Transitions,
    as_batch,
    left_out,
    needed,
    transitions,
    whole_episodes,
)
from ibdata.dataset.viewed import (
    BLOCK_ROWS,
    arrays_of,
    batches_of,
    checked_history,
    checked_length,
    windows_of,
)
from ibdata.dataset.windows import Windows
from ibdata.errors import UsageError
from ibdata.views.options import View, ViewOptions, view_of

if TYPE_CHECKING:
    import pandas as pd


class Dataset(Shards):
    """A finished dataset in a folder or at a URL. Only files that its manifest lists are read.

    If the dataset is replaced after it was opened, reading raises BusyError. Functions that take a folder
    take a Dataset too.

    Args:
        path: The folder, or a URL such as s3://bucket/name. If the folder is not there, it is looked for in
            data/, so that the name of a shipped experiment finds its dataset.

    Attributes:
        path: The folder, from the root; UsageError at a URL.
        place: The folder as it was given, or the URL without credentials, as a text.

    Raises:
        DatasetError: There is no finished dataset, or its manifest is damaged.
    """

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
            split: Only rows of this split.
            setpoint: Only rows at this setpoint, or at these; moving ones count by their first value.
            policy: Only rows of the policy with this label, or with these.
            view: The options of a view, a mapping of some of observe, actions, reward, reward_scale and
                imperfections (docs/views.md). The columns are then episode, step, those of the frame, the
                actions, the reward, the flags, and `next_…` of the frame.

        Raises:
            UsageError: The dataset has no such column, split, setpoint or policy, or both columns and a view
                are given.
            DatasetError: A file is missing or damaged.
        """
        if view is not None:
            _refuse_columns(columns)
            info, options = self.info_model, view_of(view)
            rows = self.table(needed(info, options), split, setpoint=setpoint, policy=policy)
            made = transitions(rows, info, options)
            return pa.Table.from_batches([as_batch(made, options.frame(info.drifting))])
        names = self._columns(columns)
        parts: list[pa.Table] = []
        for number, runs in self._shards(split, setpoint, policy):
            whole = self.read_shard(number, names)
            if runs is None:
                parts.append(whole)
            else:
                parts.extend(whole.slice(start, stop - start) for start, stop in runs)
        if not parts:  # the split has no episode at this setpoint, or of this policy
            return self.read_shard(0, names).slice(0, 0)
        return pa.concat_tables(parts).unify_dictionaries()

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
        table = self.table(columns, split, setpoint=setpoint, policy=policy, view=view)
        frame: pd.DataFrame = table.to_pandas(ignore_metadata=True)
        if len(frame) < len(self):
            lengths = self.episode_table["length"].to_numpy()
            inside = np.repeat(self.selected(split, setpoint, policy), lengths)
            if left_out(self.info_model, view_of(view)):
                inside[np.cumsum(lengths) - 1] = False
            frame.index = np.flatnonzero(inside)
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
            at: `(episode, step)` of the row to begin at; by default the first one.

        Raises:
            UsageError: `rows` is below 1, or the dataset has no such column, split or row; or both a split
                and a row are given.
            DatasetError: A file is missing or damaged.
        """
        checked_length(rows, "rows")
        if at is None:
            batches = self.iter_batches(columns, split, rows)
        elif split is not None:
            raise UsageError("at: found a split too; leave one of them out")
        else:
            batches = self._batches_from(*self._place_of(at), self._columns(columns), rows)
        parts, missing = [], rows
        for batch in batches:
            parts.append(batch.slice(0, missing))
            missing -= parts[-1].num_rows
            if not missing:
                break
        return pa.Table.from_batches(parts)

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
        checked_length(batch_rows, "batch_rows")
        if view is not None:
            _refuse_columns(columns)
            options = view_of(view)
            blocks = self._blocks(options, split, setpoint, policy, batch_rows)
            return batches_of(blocks, options.frame(self.info_model.drifting), batch_rows)
        names, shards = self._columns(columns), self._shards(split, setpoint, policy)
        parts = (rows_in(self.shard_batches(number, names, batch_rows), runs) for number, runs in shards)
        return chain.from_iterable(parts)

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
            truncated, episode and step (N,), and the further columns by name. If the view observes values
            that the dataset does not have after the last row of an episode, that row is left out.

        Raises:
            UsageError: An argument is invalid, or the dataset has no such split, column, setpoint or policy.
            DatasetError: A file is missing or damaged.
        """
        drop, options = checked_history(history, pad), view_of(view)
        more = self._columns(columns) if len(columns) else []
        names = list(dict.fromkeys([*needed(self.info_model, options), *more]))
        table = self.table(names, split, setpoint=setpoint, policy=policy)
        return arrays_of(table, self.info_model, options, history, drop, more)

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
        blocks = self._blocks(options, split, setpoint, policy)
        episodes = self.episode_table.filter(self.selected(split, setpoint, policy))
        root = self.content_root
        return windows_of(blocks, episodes, self.info_model, options, root, folder, history, drop)

    @public
    def statistics(self, split: Split = None) -> dict[str, Any]:
        """Statistics of the float columns. Those of a later split are computed from its rows.

        Args:
            split: Only the rows of this split; by default all rows.

        Returns:
            For each column: count, mean, std, min, max, and quantiles by their probability, such as "0.5".

        Raises:
            UsageError: The dataset has no such split.
            DatasetError: A file is missing or damaged.
        """
        if split is not None and not self.split_entry(split).declared:
            from ibdata.dataset.statistics import of_batches  # compiles, which other readers do without

            names = [column.name for column in self.info_model.columns if column.dtype.startswith("float")]
            columns = of_batches(self.iter_batches(names, split), names, self.split_entry(split).rows)
        else:
            path = "meta/statistics.json"
            stored = manifest.read_json(self.storage, self.manifest_model, path, Statistics)
            columns = stored.all if split is None else stored.splits[split]
        return {name: column.plain() for name, column in columns.items()}

    def _blocks(
        self, options: ViewOptions, split: Split, setpoint: Setpoint, policy: Policy, rows: int = BLOCK_ROWS
    ) -> Iterator[Transitions]:
        """The transitions in order, those of whole episodes with about `rows` rows at a time.

        Raises UsageError at once if a selection or the view does not fit the dataset.
        """
        info = self.info_model
        batches = self.iter_batches(needed(info, options), split, rows, setpoint=setpoint, policy=policy)
        return (transitions(table, info, options) for table in whole_episodes(batches, self.place))


def _refuse_columns(columns: Columns) -> None:
    if columns is not None:
        raise UsageError("columns: found columns beside a view, which has its own; leave one out")


Place = Dataset | str | os.PathLike[str]


def opened(place: Place) -> Dataset:
    """Return a dataset as it is, or open the one in a folder or at a URL."""
    return place if isinstance(place, Dataset) else Dataset(place)
