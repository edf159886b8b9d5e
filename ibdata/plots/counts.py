"""Histograms of a dataset's rows, counted in one pass and in constant memory."""

from __future__ import annotations

from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.dataset.reader import Dataset
from ibdata.errors import DatasetError
from ibdata.plots.groups import Episodes, Floats, Numbers

STEERINGS = ("obs_velocity", "obs_gain", "obs_shift")
PAIRS = tuple(combinations(range(len(STEERINGS)), 2))
ACTIONS = ("act_velocity", "act_gain", "act_shift")
COSTS = ("next_obs_consumption", "next_obs_fatigue")
STEERING_EDGES = np.linspace(0.0, 100.0, 51)
ACTION_EDGES = np.linspace(-1.0, 1.0, 42)  # an odd number of bins, so that 0 is in the middle of one
COST_BINS = 60


class Counts(NamedTuple):
    """Histograms over all rows. A bin includes its lower edge, and the last bin its upper edge too."""

    reward_edges: Floats
    rewards: Numbers  # (setpoints, bins)
    coverage: Numbers  # (pairs of steerings, bins of the first, bins of the second)
    cost_edges: tuple[Floats, Floats]
    costs: Numbers  # (bins of consumption, bins of fatigue)
    mean_costs: Floats  # (setpoints, policies, 2); NaN where there are no rows
    actions: Numbers  # (policies, actions, bins)


def count(dataset: Dataset, episodes: Episodes) -> Counts:
    """Count the rows of a dataset. Raises DatasetError if rows or statistics are damaged."""
    edges = {name: _edges(dataset, name) for name in ("reward", *COSTS)}
    cells = len(episodes.setpoints) * len(episodes.policies)
    cost_edges = (edges[COSTS[0]], edges[COSTS[1]])
    made = Counts(
        edges["reward"],
        np.zeros((len(episodes.setpoints), COST_BINS), np.int64),
        np.zeros((len(PAIRS), *[len(STEERING_EDGES) - 1] * 2), np.int64),
        cost_edges,
        np.zeros((COST_BINS, COST_BINS), np.int64),
        np.zeros((cells, 2)),
        np.zeros((len(episodes.policies), len(ACTIONS), len(ACTION_EDGES) - 1), np.int64),
    )
    rows = np.zeros(cells, np.int64)
    cell, stops = episodes.cell(), np.cumsum(episodes.length)
    first = 0
    for batch in dataset.iter_batches([*STEERINGS, *ACTIONS, "reward", *COSTS]):
        stop = first + batch.num_rows
        if stop > stops[-1]:
            break
        of = np.searchsorted(stops, np.arange(first, stop), side="right")
        x = {name: batch.column(name).to_numpy() for name in batch.schema.names}
        _add(made, x, episodes.setpoint[of], episodes.policy[of], cell[of])
        rows += np.bincount(cell[of], minlength=cells)
        first = stop
    if first != stops[-1]:
        raise DatasetError(
            f"{dataset.path}: found more or fewer rows than in meta/episodes.parquet, expected {stops[-1]}; "
            f"see ibdata validate {dataset.path}"
        )
    sums = np.where(rows[:, None] > 0, made.mean_costs, np.nan) / np.maximum(rows, 1)[:, None]
    return made._replace(mean_costs=sums.reshape(len(episodes.setpoints), len(episodes.policies), 2))


def _add(
    made: Counts, x: dict[str, npt.NDArray[Any]], setpoint: Numbers, policy: Numbers, cell: Numbers
) -> None:
    """Add rows to the counts; mean_costs holds sums until all rows are counted."""
    _into(made.rewards, setpoint, bins(x["reward"], made.reward_edges))
    places = [bins(x[name], STEERING_EDGES) for name in STEERINGS]
    for into, (a, b) in zip(made.coverage, PAIRS, strict=True):
        _into(into, places[a], places[b])
    _into(made.costs, *(bins(x[name], edges) for name, edges in zip(COSTS, made.cost_edges, strict=True)))
    for i, name in enumerate(COSTS):
        made.mean_costs[:, i] += np.bincount(cell, weights=x[name], minlength=len(made.mean_costs))
    for i, name in enumerate(ACTIONS):
        _into(made.actions[:, i], policy, bins(x[name], ACTION_EDGES))


def bins(values: npt.NDArray[Any], edges: Floats) -> Numbers:
    """The bin of each value (n,); values outside are in the first or the last bin.

    >>> bins(np.array([0.0, 0.5, 1.0, 2.0]), np.array([0.0, 1.0, 2.0]))
    array([0, 0, 1, 1])
    """
    return np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)


def _into(counts: Numbers, row: Numbers, column: Numbers) -> None:
    wide = counts.shape[1]
    counts += np.bincount(row * wide + column, minlength=counts.size).reshape(counts.shape)


def _edges(dataset: Dataset, name: str) -> Floats:
    """Edges of equal bins from the minimum to the maximum of a column in meta/stats.json."""
    stat = dataset.statistics().get(name, {})
    low, high = stat.get("min"), stat.get("max")
    if low is None or high is None or low > high:
        raise DatasetError(
            f"{dataset.path}: meta/stats.json: {name}: found min {low} and max {high}, expected numbers with "
            f"min <= max; see ibdata validate {dataset.path}"
        )
    return np.linspace(*((low, high) if low < high else (low - 0.5, high + 0.5)), COST_BINS + 1)
