"""Episodes of a dataset that are to be read: of a split, at some setpoints, of some policies, and others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ibdata.dataset.conditions import (
    Limits,
    Numbers,
    Policy,
    Setpoint,
    Split,
    known_of,
    limits_of,
)
from ibdata.dataset.models import Info
from ibdata.dataset.readable import Readable
from ibdata.dataset.splits import runs_of
from ibdata.dataset.stored import Stored
from ibdata.dataset.transitions import Transitions, needed, transitions, whole_episodes
from ibdata.dataset.viewed import BLOCK_ROWS
from ibdata.errors import UsageError, printable
from ibdata.numerics.naming import counted, decimal
from ibdata.numerics.whole_numbers import within
from ibdata.views.options import ViewOptions

Runs = list[tuple[int, int]]
Mask = npt.NDArray[np.bool_]


class Selection(Readable):
    """Some episodes of a dataset. Rows are read, and fewer episodes selected, as of the dataset itself.

    `content_root`, `info` and `place` are those of the dataset; all else is of the selected episodes.
    """

    def __init__(
        self,
        stored: Stored,
        mask: Mask | None = None,
        declared: str | None = None,
        is_by_returns: bool = False,
    ) -> None:
        self.stored = stored
        self.mask = mask  # whether each episode of the dataset is selected; None for all of them
        self.declared = declared  # the declared split that this is, if it is one
        self.is_by_returns = is_by_returns  # whether its episodes were chosen by their returns

    def __repr__(self) -> str:
        episodes = counted(int(self.inside.sum()), "episode")
        return f"<ibdata.Selection of {printable(self.place)}: {counted(len(self), 'row')}, {episodes}>"

    def __len__(self) -> int:
        if self.mask is None:
            return self.stored.manifest.rows
        return int(self.stored.episodes["length"].to_numpy()[self.mask].sum())

    @property
    def inside(self) -> Mask:
        """Whether each episode of the dataset is selected, (episodes,)."""
        return np.ones(len(self.stored.episodes), dtype=np.bool_) if self.mask is None else self.mask

    @property
    def episode_table(self) -> pa.Table:
        """The selected rows of the table of episodes, without later splits."""
        table = self.stored.episodes
        return table if self.mask is None else table.filter(self.mask)

    @property
    def _everything(self) -> Selection:
        return self

    def narrowed(
        self, split: Split, setpoint: Setpoint, policy: Policy, episodes: Numbers, returns: Limits
    ) -> Selection:
        """Those of these episodes that meet further conditions, see `select`."""
        others = (setpoint, policy, episodes, returns)
        has_others = any(condition is not None for condition in others)
        if split is None and not has_others:
            return self
        mask, splits = self.inside & meeting(self.stored.episodes, *others), []
        if split is not None:
            splits = known_splits(self.stored, split)
            mask &= in_splits(self.stored, splits)
        only = splits[0] if len(splits) == 1 and not has_others else None
        is_declared = only is not None and self.mask is None and self.stored.splits[only].declared
        is_by_returns = self.is_by_returns or returns is not None
        return Selection(self.stored, mask, only if is_declared else None, is_by_returns)

    def refuse_empty(self) -> None:
        """Raise UsageError if there is no episode in it."""
        if self.mask is not None and not self.mask.any():
            raise UsageError(
                "split, setpoint, policy, episodes, returns: found no episode that meets all, "
                "expected at least one"
            )

    def refuse_by_returns(self) -> None:
        """Raise UsageError if episodes were chosen by their returns, so that chance in them is not fair."""
        if self.is_by_returns:
            raise UsageError(
                "returns: found episodes that were chosen by their returns, expected all, whatever came of "
                "them: the chosen ones were lucky or unlucky; leave out returns"
            )

    def row_numbers(self, without_last: bool) -> npt.NDArray[np.int64]:
        """The numbers of the rows in the dataset, perhaps without the last of each episode."""
        lengths = self.stored.episodes["length"].to_numpy()
        inside = np.repeat(self.inside, lengths)
        if without_last:
            inside[np.cumsum(lengths) - 1] = False
        return np.flatnonzero(inside)

    def rows(self, columns: Sequence[str]) -> pa.Table:
        """These columns of all rows."""
        parts: list[pa.Table] = []
        for number, runs in self._shards():
            shard = self.stored.rows(number, columns)
            parts.extend([shard] if runs is None else (shard.slice(a, b - a) for a, b in runs))
        return pa.concat_tables(parts).unify_dictionaries()

    def batches(self, columns: Sequence[str], most: int) -> Iterator[pa.RecordBatch]:
        """These columns of the rows in order, at most so many rows at a time."""
        shards = ((self.stored.batches(number, columns, most), runs) for number, runs in self._shards())
        return chain.from_iterable(rows_in(batches, runs) for batches, runs in shards)

    def transitions(self, options: ViewOptions, rows: int = BLOCK_ROWS) -> Iterator[Transitions]:
        """The transitions in order, those of whole episodes with about `rows` rows at a time.

        Raises UsageError at once if the view does not fit the dataset.
        """
        info: Info = self.stored.info
        batches = self.batches(needed(info, options), rows)
        return (transitions(table, info, options) for table in whole_episodes(batches, self.place))

    def column_statistics(self) -> dict[str, Any]:
        """The statistics of each float column."""
        if self.mask is None:
            return self.stored.statistics.all
        if self.declared is not None:
            return self.stored.statistics.splits[self.declared]
        from ibdata.dataset.statistics import of_batches  # compiles, which other readers do without

        names = [column.name for column in self.stored.info.columns if column.dtype.startswith("float")]
        return of_batches(self.batches(names, BLOCK_ROWS), names, len(self))

    def _shards(self) -> list[tuple[int, Runs | None]]:
        """The numbers of the shards to read, each with the runs of rows to read, or None for all rows."""
        if self.mask is None:
            return [(number, None) for number in range(len(self.stored.manifest.shards))]
        return sorted(rows_of(self.episode_table).items())


def in_splits(stored: Stored, splits: Sequence[str]) -> Mask:
    """Whether each episode is in one of these splits."""
    mask = np.zeros(len(stored.episodes), dtype=np.bool_)
    for split in splits:
        for first, stop in runs_of(split, stored.splits[split], stored.manifest):
            mask[first:stop] = True
    return mask


def meeting(table: pa.Table, setpoint: Setpoint, policy: Policy, numbers: Numbers, returns: Limits) -> Mask:
    """Whether each episode of a table meets all conditions that are not None.

    Raises UsageError if the dataset has no such setpoint, policy or episode, or if the limits are invalid.
    """
    mask = np.ones(len(table), dtype=np.bool_)
    if setpoint is not None:
        values = table["setpoint"].to_numpy()
        with np.errstate(over="ignore"):  # of the column's type, in which 20.1 is the number nearest to it
            points = np.array(setpoint, values.dtype).ravel()
        known_of("setpoint", list(map(decimal, points)), list(map(decimal, np.unique(values))))
        mask &= np.isin(values, points)
    if policy is not None:
        labels = table["policy"].combine_chunks()
        names = labels.dictionary.to_pylist()
        places = [names.index(name) for name in known_of("policy", policy, names)]
        mask &= np.isin(labels.indices.to_numpy(), places)
    if numbers is not None:
        mask &= np.isin(np.arange(len(table)), within("episodes", numbers, len(table)))
    if returns is not None:
        low, high = limits_of(returns)
        values = table["return"].to_numpy()
        mask &= (low <= values) & (values <= high)
    return mask


def known_splits(stored: Stored, split: Split) -> list[str]:
    """One or several splits as a list. Raises UsageError for one that the dataset does not have."""
    if not stored.splits:
        raise UsageError(f"split: found {split!r}, expected no split: the dataset declares no splits")
    return known_of("split", split, list(stored.splits))


def rows_of(episodes: pa.Table) -> dict[int, Runs]:
    """The rows of episodes in each shard, as runs start … stop - 1."""
    by_shard: dict[int, Runs] = {}
    columns = (episodes[name].to_numpy().tolist() for name in ("shard", "row_start", "row_stop"))
    for shard, start, stop in zip(*columns, strict=True):
        runs = by_shard.setdefault(shard, [])
        if runs and runs[-1][1] == start:
            start = runs.pop()[0]
        runs.append((start, stop))
    return by_shard


def rows_in(batches: Iterator[pa.RecordBatch], runs: Runs | None) -> Iterator[pa.RecordBatch]:
    """The rows of a shard that are in the runs, or all of them, from its batches in order."""
    first = 0
    for batch in batches:
        stop = first + batch.num_rows
        for start, end in [(first, stop)] if runs is None else runs:
            low, high = max(start, first), min(end, stop)
            if low < high:
                yield batch.slice(low - first, high - low)
        first = stop
