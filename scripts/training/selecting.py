"""Off-policy evaluation and selection: its target policies, its results, and how estimators are measured."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd

from ibdata.dataset.models import JsonObject, Sha256

SETS = (
    "siemens-offline/bad-60",
    "siemens-offline/optimized-60",
    "siemens-offline/global-100",
    "d4rl-like/medium",
)
GRID = (1500, 3000, 6000, 10_000, 12_500, 15_000)  # steps of training
AT = {"bc": (*GRID[:4], GRID[5]), "td3+bc": GRID, "iql": GRID, "cql": GRID[:3]}
PER_DECISION, WEIGHTED, FQE, MODEL = ESTIMATORS = ("per decision", "weighted", "FQE", "model")
CHOSEN = (1, 5)  # policies that a selection takes
RESAMPLES = 1000  # of the bootstrap
Floats = npt.NDArray[np.float64]


class Checkpoint(NamedTuple):
    """A target policy: what an algorithm has learned from a set after some steps of training."""

    set: str
    algorithm: str
    training_steps: int

    def file(self, folder: Path) -> Path:
        """The file of its network."""
        name = f"{self.set.replace('/', '-')}-{self.algorithm}-{self.training_steps}.safetensors"
        return folder / "policies" / name


class Estimate(JsonObject):
    """A mean return, discounted and unscaled, with its standard error and 95 % interval if there is one.

    The mean is None if an estimator has none.
    """

    mean_return: float | None
    standard_error: float | None = None
    interval: tuple[float, float] | None = None


class Line(JsonObject):
    """A target policy, given by the SHA-256 of its network, its true value and the estimates of it."""

    set: str
    algorithm: str
    training_steps: int
    sha256: Sha256
    content_root: Sha256  # of the set
    value: Estimate  # the true one
    estimates: dict[str, Estimate]  # by estimator
    effective: dict[str, float]  # effective sample size of the weights, by the number of steps
    cpu_seconds: dict[str, float]  # by estimator
    versions: dict[str, str]

    @property
    def key(self) -> Checkpoint:
        """The target policy."""
        return Checkpoint(self.set, self.algorithm, self.training_steps)


class Measure(NamedTuple):
    """A number that says how good an estimator is, with its 95 % interval."""

    value: float
    low: float
    high: float


def plan() -> list[Checkpoint]:
    """All target policies in their order: of each set, 20."""
    return [Checkpoint(name, each, steps) for name in SETS for each in AT for steps in AT[each]]


def absolute_error(values: Floats, estimates: Floats) -> float:
    """The mean of |estimate - value| over the policies."""
    return float(np.abs(estimates - values).mean())


def rank_correlation(values: Floats, estimates: Floats) -> float:
    """Spearman's rank correlation; NaN if either has no two different numbers."""
    with np.errstate(invalid="ignore"):  # older versions of pandas warn of such
        return float(pd.Series(values).rank().corr(pd.Series(estimates).rank()))


def regret(values: Floats, estimates: Floats, k: int) -> float:
    """The best value of all policies minus the best value of the k with the greatest estimates.

    Of equal estimates, those of the earlier policies count as greater.
    """
    chosen = np.argsort(-estimates, kind="stable")[:k]
    return float(values.max() - values[chosen].max())


def chance_regret(values: Floats, k: int) -> float:
    """The expected regret if the k policies are drawn at random, without replacement."""
    n = len(values)
    shares = [math.comb(i, k - 1) / math.comb(n, k) for i in range(n)]  # that the i-th lowest is the best
    return float(values.max() - np.sort(values) @ np.array(shares))


def measured(
    values: Floats, estimates: Floats, measure: Callable[[Floats, Floats], float], seed: int = 0
) -> Measure:
    """A measure of an estimator, and its percentile bootstrap interval over the policies.

    Resamples without a measure, such as those in which all policies are the same, are left out.
    """
    draws = np.random.default_rng(seed).integers(len(values), size=(RESAMPLES, len(values)))
    found = [measure(values[one], estimates[one]) for one in draws]
    kept = [x for x in found if not math.isnan(x)]
    low, high = np.quantile(kept, [0.025, 0.975]) if kept else (math.nan, math.nan)
    return Measure(measure(values, estimates), float(low), float(high))


def values_of(lines: Sequence[Line]) -> Floats:
    """The true values (n,) of policies."""
    return np.array([line.value.mean_return for line in lines], dtype=np.float64)


def estimates_of(lines: Sequence[Line], estimator: str) -> Floats | None:
    """The estimates (n,) of all policies; None if some policy has none."""
    found = [line.estimates[estimator].mean_return for line in lines]
    return None if None in found else np.array(found, dtype=np.float64)
