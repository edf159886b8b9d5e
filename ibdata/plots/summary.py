"""What the pictures of a dataset show: its episodes in groups, and histograms of its rows.

The rows are counted in one pass and in constant memory.
"""

from __future__ import annotations

from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arrays import Floats, Ints
from ibdata._system.progress import bar
from ibdata.dataset.dataset import Dataset
from ibdata.dataset.models import Quantile
from ibdata.errors import DatasetError
from ibdata.plots.style import SERIES
from ibdata.views.options import ACTIONS

MOST_SETPOINTS = 12
STEERINGS = ("obs_velocity", "obs_gain", "obs_shift")
PAIRS = tuple(combinations(range(len(STEERINGS)), 2))
DRAWN_COSTS = ("next_obs_consumption", "next_obs_fatigue")
STEERING_EDGES = np.linspace(0.0, 100.0, 51)
ACTION_EDGES = np.linspace(-1.0, 1.0, 42)  # an odd number of bins, so that 0 is in the middle of one
COST_BINS = 60
REWARD_BINS = 5000  # so narrow that quantiles can be read from them
TAILS: tuple[Quantile, Quantile] = ("0.05", "0.95")
ROOM = 0.75  # on both sides of these quantiles, as a share of their distance


class Summary:
    """A dataset with its rows counted and its episodes in groups, few enough to be told apart in a picture.

    With more than 12 setpoints, neighbours share a group. With more than 7 policies, the last group has all
    others.

    Attributes:
        setpoints, policies: The names of the groups.
        levels: The middle of each group of setpoints.
        setpoint, policy: The groups of each episode (n,), by number.
        counts: Histograms over all rows.

    Raises:
        DatasetError: A setpoint or return is not a finite number, or rows or statistics are damaged.
    """

    def __init__(self, dataset: Dataset, progress: bool | None = False) -> None:
        self.dataset = dataset
        self.episodes = dataset.episodes
        values, number = np.unique(self._finite("setpoint"), return_inverse=True)
        runs = np.array_split(values, min(len(values), MOST_SETPOINTS))
        self.setpoints = [f"{run[0]:g}" if len(run) == 1 else f"{run[0]:g} – {run[-1]:g}" for run in runs]
        self.levels = np.array([(run[0] + run[-1]) / 2 for run in runs])
        self.setpoint = np.repeat(np.arange(len(runs)), [len(run) for run in runs])[number]
        self.policies, self.policy = _first(list(self.episodes["policy"]))
        self.returns = self._finite("return")
        cells = (len(self.setpoints), len(self.policies))
        self.counts = count(dataset, cells, self.setpoint, self.policy, progress)

    def _finite(self, name: str) -> Floats:
        values = self.episodes[name].to_numpy()
        if not np.isfinite(values).all():
            place = self.dataset.place
            raise DatasetError(
                f"{place}: found a {name} that is infinite or nan, expected finite numbers; see ibdata "
                f"validate {place}"
            )
        return values

    def label(self, column: str) -> str:
        """The label of a column on an axis: its meaning and its unit, from meta/dataset.json."""
        [described] = [entry for entry in self.dataset.stored.info.columns if entry.name == column]
        unit = {"1": "", "cost": " (cost units)"}.get(described.unit, f" ({described.unit})")
        return f"{described.description}{unit}"

    @property
    def setpoint_label(self) -> str:
        """The label of the groups of setpoints."""
        return "setpoint p at the start" if self.dataset.stored.info.drifting else "setpoint p"


def _first(policy: list[str]) -> tuple[list[str], npt.NDArray[np.int64]]:
    """The policies, or the first six and the number of the others, and the group of each episode."""
    labels = list(dict.fromkeys(policy))
    shown, most = labels, len(SERIES)
    if len(labels) > most:
        shown = [*labels[: most - 1], f"{len(labels) - most + 1} others"]
    group_of = {label: min(i, len(shown) - 1) for i, label in enumerate(labels)}
    return shown, np.array([group_of[label] for label in policy])


class Counts(NamedTuple):
    """Histograms over all rows. A bin includes its lower edge, and the last bin its upper edge too.

    Costs far from the others are in no bin.
    """

    rows: Ints  # (setpoints, policies)
    reward_edges: Floats
    rewards: Ints  # (setpoints, policies, bins)
    coverage: Ints  # (policies, pairs of steerings, bins of the first, bins of the second)
    cost_edges: tuple[Floats, Floats]
    costs: Ints  # (bins of consumption, bins of fatigue)
    mean_costs: Floats  # (setpoints, policies, 2); NaN where there are no rows
    actions: Ints  # (policies, actions, bins)


def count(
    dataset: Dataset, cells: tuple[int, int], setpoint: Ints, policy: Ints, progress: bool | None
) -> Counts:
    """Count the rows by the groups (setpoint, policy) of their episodes (n,)."""
    counts = Counts(
        np.zeros(cells, np.int64),
        np.linspace(*_range(dataset, "reward"), REWARD_BINS + 1),
        np.zeros((*cells, REWARD_BINS), np.int64),
        np.zeros((cells[1], len(PAIRS), *[len(STEERING_EDGES) - 1] * 2), np.int64),
        (_cost_edges(dataset, DRAWN_COSTS[0]), _cost_edges(dataset, DRAWN_COSTS[1])),
        np.zeros((COST_BINS, COST_BINS), np.int64),
        np.zeros((*cells, 2)),
        np.zeros((cells[1], len(ACTIONS), len(ACTION_EDGES) - 1), np.int64),
    )
    stops = np.cumsum(dataset.episodes["length"])
    first = 0
    with bar(progress, len(dataset), "rows", "count") as advance:
        for batch in dataset.iter_batches([*STEERINGS, *ACTIONS, "reward", *DRAWN_COSTS]):
            stop = first + batch.num_rows
            episode = np.searchsorted(stops, np.arange(first, stop), side="right")
            x = {name: batch.column(name).to_numpy() for name in batch.schema.names}
            _add(counts, x, setpoint[episode], policy[episode])
            advance(batch.num_rows)
            first = stop
    rows = counts.rows[..., None]
    return counts._replace(mean_costs=np.where(rows > 0, counts.mean_costs, np.nan) / np.maximum(rows, 1))


def _add(counts: Counts, x: dict[str, npt.NDArray[Any]], setpoint: Ints, policy: Ints) -> None:
    """Add rows to the counts; mean_costs holds sums until all rows are counted."""
    _into(counts.rows, setpoint, policy)
    _into(counts.rewards, setpoint, policy, bins(x["reward"], counts.reward_edges))
    places = [bins(x[name], STEERING_EDGES) for name in STEERINGS]
    for i, (a, b) in enumerate(PAIRS):
        _into(counts.coverage[:, i], policy, places[a], places[b])
    costs, (c, f) = [x[name] for name in DRAWN_COSTS], counts.cost_edges
    near = (costs[0] >= c[0]) & (costs[0] <= c[-1]) & (costs[1] >= f[0]) & (costs[1] <= f[-1])
    _into(counts.costs, bins(costs[0][near], c), bins(costs[1][near], f))
    for i, values in enumerate(costs):
        _into(counts.mean_costs[..., i], setpoint, policy, weights=values)
    for i, name in enumerate(ACTIONS):
        _into(counts.actions[:, i], policy, bins(x[name], ACTION_EDGES))


def bins(values: npt.NDArray[Any], edges: Floats) -> Ints:
    """The bin of each value (n,); values outside are in the first or the last bin.

    >>> bins(np.array([0.0, 0.5, 1.0, 2.0]), np.array([0.0, 1.0, 2.0]))
    array([0, 0, 1, 1])
    """
    return np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)


def _into(counts: npt.NDArray[Any], *places: Ints, weights: npt.NDArray[Any] | None = None) -> None:
    flat = np.ravel_multi_index(places, counts.shape)
    counts += np.bincount(flat, weights, minlength=counts.size).reshape(counts.shape)


def _range(dataset: Dataset, name: str) -> tuple[float, float]:
    """The least and the greatest value of a column, or some room around its only value."""
    stat = dataset.statistics().get(name, {})
    low, high = stat.get("min"), stat.get("max")
    if low is None or high is None or low > high:
        raise DatasetError(
            f"{dataset.place}: meta/statistics.json: {name}: found min {low} and max {high}, expected "
            f"numbers with min <= max; see ibdata validate {dataset.place}"
        )
    return (low, high) if low < high else (low - 0.5, high + 0.5)


def _cost_edges(dataset: Dataset, name: str) -> Floats:
    """Edges of equal bins around the quantiles of 5 and 95 % of all rows."""
    low, high = _range(dataset, name)
    tails = [dataset.statistics()[name]["quantiles"][tail] for tail in TAILS]
    if None not in tails and tails[0] < tails[1]:
        room = ROOM * (tails[1] - tails[0])
        low, high = max(low, tails[0] - room), min(high, tails[1] + room)
    return np.linspace(low, high, COST_BINS + 1)
