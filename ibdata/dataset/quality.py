"""Measures of the quality of data from the literature."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ibdata._numerics.arguments import public
from ibdata._numerics.arrays import Floats, Ints
from ibdata.dataset.dataset import Place, opened
from ibdata.dataset.episodes import BLOCK_ROWS
from ibdata.dataset.models import Info
from ibdata.dataset.reference_returns import EXPERT, scale_of
from ibdata.dataset.tabular import Table, Tabular
from ibdata.dataset.transitions import stacked_columns, whole_episodes
from ibdata.views.options import ACTIONS

STEERINGS = ("obs_velocity", "obs_gain", "obs_shift")
DENSITY = "action_log_prob"
LEAST_ROWS = 10  # of a cell; the standard deviation of fewer is too small on average
SETPOINT_WIDTH, SETPOINT_BINS = 5.0, 21  # intervals, which begin at 0, 5 … 100
STEERING_WIDTH, STEERING_BINS = 10.0, 10  # of velocity, gain and shift; 100 belongs to the last interval
ACTION_WIDTH, ACTION_BINS = 0.4, 5  # of each change; 1 belongs to the last interval
STATES = SETPOINT_BINS * STEERING_BINS**3
PAIRS = STATES * ACTION_BINS**3
MEANING = {
    "trajectory_quality": "mean return: 0 = random, 1 = expert",
    "return_improvement": "(best return - mean return) / (mean return - lowest return)",
    "state_action_coverage": "different pairs of state and action: 1 = as many as random actions",
    "action_stochasticity": "standard deviation of the actions in a square of the state grid",
    "action_entropy": "from the recorded densities: 0 = deterministic, 2.08 = random; no bounds",
}


@dataclasses.dataclass(frozen=True, repr=False)
class Quality(Tabular):
    """Measures of the quality of a dataset; a measure is None where it is not defined.

    Attributes:
        rows: the number of rows.
        episodes: the number of episodes.
        trajectory_quality: where the mean return is between `random`, 0, and `expert`, 1.
        return_improvement: (best return - mean return) / (mean return - lowest return).
        state_action_coverage: `pairs` divided by `reference_pairs`.
        action_stochasticity: the standard deviation of the actions in a cell of a grid of states.
        action_entropy: from the recorded densities: 0 for a deterministic policy, 2.08 for `random`.
        pairs: the number of different pairs of a state and an action on a grid.
        reference_pairs: as many random actions have so many different pairs.
    """

    rows: int
    episodes: int
    trajectory_quality: float | None
    return_improvement: float | None
    state_action_coverage: float
    action_stochasticity: float | None
    action_entropy: float | None
    pairs: int
    reference_pairs: int

    def tables(self) -> list[Table]:
        """The measures, a row each."""
        rows = [(name.replace("_", " "), getattr(self, name), said) for name, said in MEANING.items()]
        size = f"{self.rows:,} rows in {self.episodes:,} episodes, {self.pairs:,} different pairs"
        return [Table(("measure", "value", "meaning"), rows, [size])]

    def plain(self) -> dict[str, Any]:
        """The result as plain data."""
        return dataclasses.asdict(self)


@public
def quality(ds: Place, split: str | Sequence[str] | None = None) -> Quality:
    """Measure the quality of a dataset for offline reinforcement learning, in one pass in bounded memory.

    Trajectory quality and state-action coverage are those of Schweighofer et al. 2022 (arXiv 2111.04714),
    return improvement and action stochasticity those of Swazinna, Udluft and Runkler 2021 (arXiv 2111.13461).
    The entropy needs the recorded densities and no behaviour model. The page "Quality of data and
    models" has their definitions, grid and reference data, and the values of the shipped sets.

    Args:
        ds: The dataset, its folder or URL, or a selection of its episodes.
        split: Only episodes of this split, or of these.

    Returns:
        The measures. The trajectory quality is None if ibdata has no reference returns for the dynamics,
        start, setpoint and length of all episodes; see `Dataset.returns`.

    Raises:
        UsageError: The dataset has no such split, or the selection is empty.
        DatasetError: A file is missing or damaged.
    """
    selection = opened(ds).select(split)
    names = ["obs_setpoint", *STEERINGS, *ACTIONS, DENSITY, "step", "terminated", "truncated"]
    batches, episodes = selection.iter_batches(names, batch_rows=BLOCK_ROWS), selection.episode_table
    coverage, stochasticity, entropies = Coverage(), Stochasticity(), []
    rows = 0
    for table in whole_episodes(batches, selection.place):
        at = table["obs_setpoint"].to_numpy()
        steerings, actions = (stacked_columns(table, x).astype(np.float64) for x in (STEERINGS, ACTIONS))
        lengths = np.diff(np.flatnonzero(np.append(table["step"].to_numpy() == 0, True)))
        coverage.add(at, steerings, actions, lengths)
        stochasticity.add(state_numbers(at, steerings), actions)
        entropies.append(len(table) * action_entropy(table[DENSITY].to_numpy()))
        rows += len(table)
    entropy = math.fsum(entropies) / rows
    pairs, reference_pairs = coverage.pairs
    return Quality(
        rows,
        len(episodes),
        *return_measures(episodes, selection.stored.info),
        pairs / reference_pairs,
        stochasticity.value,
        entropy if math.isfinite(entropy) else None,
        pairs,
        reference_pairs,
    )


def trajectory_quality(mean_return: float, minimal: float, expert: float) -> float:
    """Trajectory quality TQ, which is 0 for the minimal policy and 1 for the expert.

        TQ = (ḡ(D) - ḡ(D_min)) / (ḡ(D_expert) - ḡ(D_min))

    Schweighofer et al. 2022 (arXiv 2111.04714); ḡ is the mean return of episodes.

    >>> trajectory_quality(-250_000.0, minimal=-300_000.0, expert=-200_000.0)
    0.5
    """
    return (mean_return - minimal) / (expert - minimal)


def return_improvement(returns: Floats) -> float | None:
    """Estimated relative return improvement ERI: how far the best episode is above the mean one.

        ERI = (max R - mean R) / mean R, with returns R >= 0

    Swazinna, Udluft and Runkler 2021 (arXiv 2111.13461). The returns (n,) of the Industrial Benchmark are
    negative, so the least one is subtracted from all, as two published implementations do. None if all
    are equal.

    >>> return_improvement(np.array([-400.0, -300.0, -200.0, 0.0]))  # shifted: 0, 100, 200, 400, mean 175
    1.2857142857142858
    """
    low, mean, high = float(returns.min()), math.fsum(returns) / len(returns), float(returns.max())
    return None if high == low else (high - mean) / (mean - low)


class ReturnMeasures(NamedTuple):
    """Both measures; None where there are no reference returns, or no two different returns to compare."""

    trajectory_quality: float | None
    return_improvement: float | None


def return_measures(episodes: pa.Table, info: Info) -> ReturnMeasures:
    """Both measures of episodes that may have several setpoints and lengths.

    The minimal policy is `random` and the expert `expert`, each at the setpoint of the episode. Returns at
    different setpoints cannot be compared, so the improvement is computed for each setpoint and length, and
    averaged with the numbers of episodes as weights. Returns are undiscounted.
    """
    setpoints, lengths, returns = (
        np.array(episodes[name].to_pylist()) for name in ("setpoint", "length", "return")
    )
    ends, improvements, weights = [], [], []
    for p, steps in np.unique(np.column_stack([setpoints, lengths]), axis=0).tolist():
        at_setpoint = returns[(setpoints == p) & (lengths == steps)]
        scale = scale_of(info, int(steps))
        end = scale.ends([p], EXPERT) if scale else None
        ends.append(None if end is None else (len(at_setpoint) * end[0], len(at_setpoint) * end[1]))
        if (improvement := return_improvement(at_setpoint)) is not None:
            improvements.append(improvement)
            weights.append(len(at_setpoint))
    known = [end for end in ends if end is not None]
    quality = None
    if len(known) == len(ends):
        quality = trajectory_quality(
            math.fsum(returns), *(math.fsum(end) for end in zip(*known, strict=True))
        )
    improvement = float(np.average(improvements, weights=weights)) if improvements else None
    return ReturnMeasures(quality, improvement)


def state_numbers(setpoint: npt.ArrayLike, steerings: npt.ArrayLike) -> Ints:
    """The numbers (n,) of the grid cells of states: setpoints (n,), and velocity, gain and shift (n, 3).

    >>> state_numbers([70.0, 70.0], [[50.0, 50.0, 50.0], [50.0, 50.0, 100.0]])
    array([14555, 14559])
    """
    number = np.floor_divide(np.asarray(setpoint, dtype=np.float64), SETPOINT_WIDTH).astype(np.int64)
    bins = np.floor_divide(np.asarray(steerings, dtype=np.float64), STEERING_WIDTH).astype(np.int64)
    for column in np.minimum(bins, STEERING_BINS - 1).T:
        number = number * STEERING_BINS + column
    return number


def pair_numbers(states: Ints, actions: npt.ArrayLike) -> Ints:
    """The numbers (n,) of the grid cells of pairs of a state, by its number (n,), and an action (n, 3).

    >>> pair_numbers(np.array([2, 2]), [[-1.0, -1.0, -1.0], [1.0, 1.0, 0.0]])
    array([250, 372])
    """
    number = states
    bins = np.floor_divide(np.asarray(actions, dtype=np.float64) + 1.0, ACTION_WIDTH).astype(np.int64)
    for column in np.minimum(bins, ACTION_BINS - 1).T:
        number = number * ACTION_BINS + column
    return number


def steered(start: Floats, actions: Floats, lengths: Ints) -> Floats:
    """Velocity, gain and shift before each action of episodes, one episode after the other (rows, 3).

    Hein et al. 2017, Eqs. (2), (3), (4): neither the setpoint nor the noise changes the three. They begin at
    start (n, 3), and episode after episode has so many of the actions (rows, 3) as lengths (n,) says.

    >>> steered(np.array([[99.5, 50.0, 0.0]]), np.array([[1.0, -0.5, -1.0], [1.0, 1.0, 1.0]]), np.array([2]))
    array([[ 99.5,  50. ,   0. ],
           [100. ,  45. ,   0. ]])
    """
    from ibdata.dynamics.setpoint import D_G, D_H, D_V  # here, for the other measures need no simulator

    inside = np.arange(lengths.max()) < lengths[:, None]
    moves = np.zeros((*inside.shape, 3))
    moves[inside] = actions * (D_V, D_G, D_H)
    out, now = np.empty_like(moves), start
    for t in range(moves.shape[1]):
        out[:, t] = now
        now = np.clip(now + moves[:, t], 0.0, 100.0)
    return out[inside]


class Coverage:
    """State-action coverage, collected from batches of whole episodes: SACo(D) = u(D) / u(D_ref).

    u is the number of different pairs (Schweighofer et al. 2022, arXiv 2111.04714). Values that are not
    discrete are never equal, so a pair is a cell of a grid. Fatigue and consumption are left out, because
    their noise alone would count. The reference is the same dataset with uniform random actions in place of
    its own, from the same velocity, gain and shift.
    """

    def __init__(self) -> None:
        self._rng = np.random.Generator(np.random.Philox(0))
        self._pairs, self._reference = np.zeros((2, PAIRS), dtype=bool)

    def add(self, setpoint: Floats, steerings: Floats, actions: Floats, lengths: Ints) -> None:
        """Add whole episodes: rows (rows,), (rows, 3), (rows, 3), and the lengths of the episodes (n,)."""
        self._pairs[pair_numbers(state_numbers(setpoint, steerings), actions)] = True
        random = 2.0 * self._rng.random((len(actions), 3)) - 1.0
        walked = steered(steerings[np.cumsum(lengths) - lengths], random, lengths)
        self._reference[pair_numbers(state_numbers(setpoint, walked), random)] = True

    @property
    def pairs(self) -> tuple[int, int]:
        """The numbers of different pairs of the data and of the reference."""
        return int(self._pairs.sum()), int(self._reference.sum())


class Stochasticity:
    """Estimated action stochasticity EAS, collected from batches of rows.

        EAS = mean over the rows of σ(s), where π(a | s) = N(μ(s), σ(s)) is fitted by maximum likelihood

    After Swazinna, Udluft and Runkler 2021 (arXiv 2111.13461), whose μ and σ are networks. Here both are
    constant in each cell of the grid of states, so that the fit is exact: the mean and the standard deviation
    of the actions in the cell. Cells with fewer than 10 rows do not count.
    """

    def __init__(self) -> None:
        self._rows = np.zeros(STATES)
        self._sums, self._squares = np.zeros((2, 3, STATES))

    def add(self, states: Ints, actions: Floats) -> None:
        """Add rows: the numbers of their states (n,) and their actions (n, 3)."""
        self._rows += np.bincount(states, minlength=STATES)
        for i in range(3):
            self._sums[i] += np.bincount(states, actions[:, i], STATES)
            self._squares[i] += np.bincount(states, actions[:, i] ** 2, STATES)

    @property
    def value(self) -> float | None:
        """The mean over rows and the three actions; None if no cell has enough rows."""
        enough = self._rows >= LEAST_ROWS
        if not enough.any():
            return None
        rows = self._rows[enough]
        variance = (self._squares[:, enough] - self._sums[:, enough] ** 2 / rows) / (rows - 1.0)
        return float(np.average(np.sqrt(np.maximum(variance, 0.0)).mean(axis=0), weights=rows))


def action_entropy(log_prob: Floats) -> float:
    """The entropy of the behaviour, estimated from the recorded densities: -mean log π(a | s).

    A deterministic policy has 0, and uniform random actions have 3 log 2 = 2.08: densities are relative to
    lengths and to unit masses. It is NaN if a density is not known.

    >>> round(action_entropy(np.log([0.5, 0.125])), 6)  # (log 2 + log 8) / 2 = 2 log 2
    1.386294
    """
    return float(-log_prob.mean(dtype=np.float64))
