"""Transitions made of the rows of whole episodes, as a view shows them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.lib.stride_tricks import sliding_window_view

from ibdata._numerics.arrays import Array
from ibdata.dataset.models import Info
from ibdata.errors import DatasetError, UsageError
from ibdata.views.imperfections import Measurement
from ibdata.views.options import ACTIONS, ViewOptions
from ibdata.views.rewards import scaled

INDICES = ("episode", "step", "terminated", "truncated")
EXPERT = tuple(f"expert_{name}" for name in ACTIONS)
PAID_BY_COLUMNS = ("obs_consumption", "obs_fatigue")  # of which rewards are made
NEXT_COSTS = ("next_obs_consumption", "next_obs_fatigue")


class Transitions(NamedTuple):
    """The n transitions of whole episodes, in order. Frames and actions have the type of the columns.

    If a view shows more than the six observed variables, they and the rewards are float32.
    """

    frames: Array  # (n, k), see `ViewOptions`
    next_frames: Array  # (n, k)
    actions: Array  # (n, 3)
    rewards: Array  # (n,)
    terminated: Array  # (n,) bool
    truncated: Array  # (n,) bool
    episode: Array  # (n,) int64
    step: Array  # (n,) int32
    rows: Array  # (n,) the rows of the table that they come from
    beside: dict[str, Array]  # what else the view and the dataset have, see BESIDE


class Beside(NamedTuple):
    """An array beside the transitions: with one column (n,), with several (n, columns)."""

    columns: tuple[str, ...]  # their names where each stands alone
    needs: Callable[[Info, ViewOptions], Sequence[str]]  # columns of the dataset; none if it is not there
    make: Callable[[pa.Table, Sequence[str], ViewOptions], Array]

    @property
    def width(self) -> tuple[int, ...]:
        """The shape of one row."""
        return () if len(self.columns) == 1 else (len(self.columns),)


def _costs(table: pa.Table, names: Sequence[str], options: ViewOptions) -> Array:
    assert options.cost is not None
    return options.cost.of(tuple(_now_and_after(table, names)[1].T))


BESIDE = {
    "costs": Beside(("cost",), lambda _, options: options.cost.variables if options.cost else (), _costs),
    "expert_actions": Beside(
        EXPERT,
        lambda info, _: info.names("expert_action"),
        lambda table, names, _: stacked_columns(table, names),
    ),
}


def beside(info: Info, options: ViewOptions) -> list[str]:
    """The names of what stands beside the transitions."""
    return [name for name, kind in BESIDE.items() if kind.needs(info, options)]


def columns_of(arrays: dict[str, Array]) -> dict[str, Array]:
    """The arrays beside transitions, each column alone."""
    return {
        column: values
        for name, array in arrays.items()
        for column, values in zip(BESIDE[name].columns, array.reshape(len(array), -1).T, strict=True)
    }


def whole_episodes(batches: Iterable[pa.RecordBatch], place: Any) -> Iterator[pa.Table]:
    """Yield the rows of batches in order, in tables of whole episodes; the batches need both flags.

    Raises DatasetError, which names the place of the dataset, if the last episode has no end.
    """
    rest: list[pa.RecordBatch] = []
    for batch in batches:
        last = np.flatnonzero(batch["truncated"].to_numpy(False) | batch["terminated"].to_numpy(False))
        if not len(last):
            rest.append(batch)
            continue
        stop = int(last[-1]) + 1
        yield pa.Table.from_batches([*rest, batch.slice(0, stop)])
        rest = [batch.slice(stop)] if stop < batch.num_rows else []
    if rest:
        raise DatasetError(f"{place}: the last episode has no end, see ibdata validate")


def first_rows(batches: Iterable[pa.RecordBatch], rows: int) -> pa.Table:
    """So many rows, of as few batches as have them."""
    parts: list[pa.RecordBatch] = []
    for batch in batches:
        parts.append(batch.slice(0, rows))
        rows -= parts[-1].num_rows
        if not rows:
            break
    return pa.Table.from_batches(parts)


def needed(info: Info, options: ViewOptions) -> list[str]:
    """The columns from which `transitions` are made.

    Raises UsageError if the view observes a column that the dataset does not have.
    """
    names, known = _followed(info, options), {column.name for column in info.columns}
    for name in names:
        if name not in known:
            option = "observe" if name in options.columns(info.drifting) else "cost"
            raise UsageError(
                f"{option}: found {name}, expected columns of the dataset, which has no such values; "
                "choose others, or generate it with another output: latent"
            )
    costs = () if options.reward.kind == "classic" else PAID_BY_COLUMNS + NEXT_COSTS
    later = [f"next_{name}" for name in names if f"next_{name}" in known]
    more = [column for kind in BESIDE.values() for column in kind.needs(info, options)]
    return list(dict.fromkeys([*INDICES, *names, *later, *ACTIONS, *more, "reward", *costs]))


def _followed(info: Info, options: ViewOptions) -> tuple[str, ...]:
    """The columns whose next values are shown: those that are observed, and those of the cost."""
    return (*options.columns(info.drifting), *(options.cost.variables if options.cost else ()))


def left_out(info: Info, options: ViewOptions) -> bool:
    """Whether the last row of each episode is left out: its next frame or cost is not in the dataset."""
    known = {column.name for column in info.columns}
    return any(f"next_{name}" not in known for name in _followed(info, options))


def transitions(table: pa.Table, info: Info, options: ViewOptions) -> Transitions:
    """Make the transitions of whole episodes.

    The next frame of a row comes from the columns `next_…` or from the row after it. If that does not give
    the last one of an episode, the last row is left out, and the episode is truncated one step before. The
    table has the columns that `needed` names.
    """
    index = {name: table[name].to_numpy() for name in INDICES}
    actions, rewards = stacked_columns(table, ACTIONS), _rewards(table, options)
    frames, after = _now_and_after(table, options.columns(info.drifting))
    kinds = {name: BESIDE[name] for name in beside(info, options)}
    more = {name: kind.make(table, kind.needs(info, options), options) for name, kind in kinds.items()}
    if left_out(info, options):
        ends = np.append(index["step"][1:] == 0, True)[: len(frames)]
        kept = np.flatnonzero(~ends)
        truncated = np.append(ends[1:], False)[: len(frames)]  # the row before the last
        index["truncated"] = truncated & ~index["terminated"]
    else:
        kept = np.arange(len(frames))
    if not options.is_classic:
        frames, after, actions = (x.astype(np.float32, copy=False) for x in (frames, after, actions))
        frames, after = _seen(frames, after, index, actions, info, options)
    if len(kept) < len(frames):
        index = {name: array[kept] for name, array in index.items()}
        frames, after, actions, rewards = (x[kept] for x in (frames, after, actions, rewards))
        more = {name: array[kept] for name, array in more.items()}
    flags = index["terminated"], index["truncated"]
    return Transitions(frames, after, actions, rewards, *flags, index["episode"], index["step"], kept, more)


def as_batch(block: Transitions, names: Sequence[str]) -> pa.RecordBatch:
    """Transitions as columns; the frames have these names."""
    columns = {
        "episode": block.episode,
        "step": block.step,
        **dict(zip(names, block.frames.T, strict=True)),
        **dict(zip(ACTIONS, block.actions.T, strict=True)),
        "reward": block.rewards,
        **columns_of(block.beside),
        "terminated": block.terminated,
        "truncated": block.truncated,
        **{f"next_{name}": column for name, column in zip(names, block.next_frames.T, strict=True)},
    }
    return pa.RecordBatch.from_pydict({name: pa.array(column) for name, column in columns.items()})


def arrays_of(
    table: pa.Table, info: Info, options: ViewOptions, history: int, drop: bool, columns: Sequence[str]
) -> dict[str, Array]:
    """The rows of whole episodes as the arrays that `Dataset.arrays` describes.

    `drop` leaves out the rows with fewer frames before them. The table has the columns too.
    """
    block = transitions(table, info, options)
    observations, after = stacked(block.frames, block.next_frames, block.step, history)
    arrays = {
        "observations": observations,
        "actions": block.actions,
        "rewards": block.rewards,
        **block.beside,
        "next_observations": after,
        "episode": block.episode,
        "step": block.step,
        "terminated": block.terminated,
        "truncated": block.truncated,
    }
    # Not those that are arrays already: where a view leaves rows out, an episode ends at an earlier one.
    arrays |= {name: table[name].to_numpy()[block.rows] for name in columns if name not in arrays}
    if not drop or history == 1:
        return {name: np.require(array, requirements="W") for name, array in arrays.items()}
    whole = block.step >= history - 1
    return {name: array[whole] for name, array in arrays.items()}


def stacked_columns(table: pa.Table, names: Sequence[str]) -> Array:
    """Columns as an array (rows, columns)."""
    return np.stack([table[name].to_numpy() for name in names], axis=1)


def _rewards(table: pa.Table, options: ViewOptions) -> Array:
    stored: Array = table["reward"].to_numpy()
    if options.reward.kind == "classic":
        return scaled(stored, options.reward_scale)
    before, after = (
        [table[name].to_numpy().astype(np.float32, copy=False) for name in names]
        for names in (PAID_BY_COLUMNS, NEXT_COSTS)
    )
    return options.reward.of(before, after, options.reward_scale)


def _now_and_after(table: pa.Table, names: Sequence[str]) -> tuple[Array, Array]:
    """The true values of columns, now and at the next step, (n, columns) each."""
    known = set(table.column_names)
    now = stacked_columns(table, names)
    after = np.empty_like(now)
    for i, name in enumerate(names):
        if f"next_{name}" in known:
            after[:, i] = table[f"next_{name}"].to_numpy()
        else:
            after[:-1, i], after[-1:, i] = now[1:, i], np.nan
    return now, after


def _seen(
    now: Array, after: Array, index: dict[str, Array], actions: Array, info: Info, options: ViewOptions
) -> tuple[Array, Array]:
    """The frames (n, k) now and at the next step: measured columns, flags, actions of the step before."""
    columns = options.columns(info.drifting)
    flagged = [columns.index(name) for name in options.flagged(info.drifting)]
    starts = np.flatnonzero(index["step"] == 0)
    lost, next_lost = np.zeros((2, *now.shape), dtype=bool)
    if options.imperfections:
        measurement = Measurement(options.imperfections, columns)
        now, after = now.copy(), after.copy()
        for start, stop in pairwise([*starts.tolist(), len(now)]):
            clean = np.concatenate([now[start:stop], after[stop - 1 : stop]])
            seen, missed = measurement.episode(clean, int(index["episode"][start]))
            now[start:stop], after[start:stop] = seen[:-1], seen[1:]
            lost[start:stop], next_lost[start:stop] = missed[:-1], missed[1:]
    parts, later = [now, lost[:, flagged]], [after, next_lost[:, flagged]]
    if options.actions:
        previous = np.roll(actions, 1, axis=0)
        previous[starts] = 0.0
        parts, later = [*parts, previous], [*later, actions]
    shown, shown_after = (np.concatenate(x, axis=1, dtype=np.float32) for x in (parts, later))
    return shown, shown_after


def stacked(observations: Array, after: Array, step: Array, history: int) -> tuple[Array, Array]:
    """Stack each observation with those before it, newest first.

    The results are copies: views would have negative strides, which PyTorch refuses.

    Args:
        observations: (N, k), of whole episodes in order; k is 6 unless a view shows other frames.
        after: The next observations (N, k).
        step: The step of each row within its episode (N,).
        history: How many observations to stack. Before the start of an episode, its first one is repeated.

    Returns:
        The histories of the observations and of the next observations, both (N, k · history).

    >>> o = np.array([[1.0], [2.0], [5.0]]); n = np.array([[2.0], [3.0], [6.0]])
    >>> now, later = stacked(o, n, np.array([0, 1, 0]), 2)
    >>> now.tolist(), later.tolist()
    ([[1.0, 1.0], [2.0, 1.0], [5.0, 5.0]], [[2.0, 1.0], [3.0, 2.0], [6.0, 5.0]])
    """
    if history == 1:
        return observations, after
    starts = np.flatnonzero(step == 0)
    width = history * observations.shape[1]
    now, later = (np.empty((len(step), width), dtype=observations.dtype) for _ in range(2))
    for start, stop in pairwise([*starts.tolist(), len(step)]):
        first, last = observations[start : start + 1], after[stop - 1 : stop]
        # The frames are reversed in memory, so that each window begins with its newest frame.
        frames = np.concatenate([last, observations[start:stop][::-1], np.repeat(first, history - 1, axis=0)])
        windows = sliding_window_view(frames.reshape(-1), width)[:: frames.shape[1]][::-1]
        now[start:stop], later[start:stop] = windows[:-1], windows[1:]
    return now, later
