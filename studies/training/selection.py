"""Off-policy evaluation and selection: target policies, results, measures of estimators, and the page."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd

from ibdata.dataset.models import JsonObject, Sha256
from measuring.documents import table, write_measured

HERE = Path(__file__).resolve().parents[1]  # studies/
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
STEPS = ("1", "3", "100")  # of which the table of weights has the effective numbers
NAMES = dict(zip(ESTIMATORS, ("per-decision IS", "weighted IS", "FQE", "model"), strict=True))
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
    return [
        Checkpoint(name, algorithm, steps) for name in SETS for algorithm in AT for steps in AT[algorithm]
    ]


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
    resampled = [measure(values[one], estimates[one]) for one in draws]
    kept = [x for x in resampled if not math.isnan(x)]
    low, high = np.quantile(kept, [0.025, 0.975]) if kept else (math.nan, math.nan)
    return Measure(measure(values, estimates), float(low), float(high))


def values_of(lines: Sequence[Line]) -> Floats:
    """The true values (n,) of policies."""
    return np.array([line.value.mean_return for line in lines], dtype=np.float64)


def estimates_of(lines: Sequence[Line], estimator: str) -> Floats | None:
    """The estimates (n,) of all policies; None if some policy has none."""
    means = [line.estimates[estimator].mean_return for line in lines]
    return None if None in means else np.array(means, dtype=np.float64)


def number(x: float, digits: int = 1) -> str:
    """A number with a true minus, and no sign if it is rounded to 0."""
    return f"{x:.{digits}f}".replace("-", "−") if round(x, digits) else f"{0.0:.{digits}f}"


def cell(measure: Measure, digits: int) -> str:
    """A measure and its interval; – if there is none."""
    if np.isnan(measure.value):
        return "–"
    return f"{number(measure.value, digits)} [{number(measure.low, digits)}, {number(measure.high, digits)}]"


def of(lines: Sequence[Line], name: str) -> list[Line]:
    """The lines of a set."""
    return [line for line in lines if line.set == name]


def measures(lines: Sequence[Line]) -> str:
    """How good each estimator is on the policies of a set, in hundreds."""
    kinds = [(absolute_error, 1), (rank_correlation, 2)]
    kinds += [(partial(regret, k=k), 1) for k in CHOSEN]
    values, rows = values_of(lines) / 100, []
    for estimator in ESTIMATORS:
        estimates, cells = estimates_of(lines, estimator), ["–"] * len(kinds)
        if estimates is not None:
            cells = [cell(measured(values, estimates / 100, kind), n) for kind, n in kinds]
        rows.append([NAMES[estimator], *cells])
    return table(["estimator", "absolute error", "rank correlation", *(f"regret@{k}" for k in CHOSEN)], rows)


def covered(lines: Sequence[Line], estimator: str) -> str:
    """How many estimates there are, and how many of their 95 % intervals contain the true value."""
    pairs = [(line.estimates[estimator].interval, line.value.mean_return or 0.0) for line in lines]
    inside = [interval[0] <= value <= interval[1] for interval, value in pairs if interval is not None]
    return f"{sum(inside)} of {len(inside)}"


def weights(lines: Sequence[Line]) -> str:
    """What becomes of the weights of each set: median effective numbers of episodes, and the intervals."""
    rows = []
    for name in SETS:
        if policies := of(lines, name):
            sizes = [[line.effective[n] for line in policies] for n in STEPS]
            shown = [f"{np.median(size):,.1f}" for size in sizes]
            intervals = [covered(policies, estimator) for estimator in (PER_DECISION, WEIGHTED)]
            rows.append([f"`{name.partition('/')[2]}`", *shown, *intervals])
    steps = [f"{n} step{'s' * (n != '1')}" for n in STEPS]
    return table(["set", *steps, NAMES[PER_DECISION], NAMES[WEIGHTED]], rows)


def shown(lines: Sequence[Line]) -> str:
    """What the page shows, of the sets that are done: a table of each measure, by estimator."""
    kinds: dict[str, tuple[Callable[[Floats, Floats], float], float, int]] = {
        "absolute error": (absolute_error, 100.0, 1),
        "rank correlation": (rank_correlation, 1.0, 2),
        "regret@1": (partial(regret, k=1), 100.0, 1),
    }
    sets = {name: of(lines, name) for name in SETS}
    sets = {x: each for x, each in sets.items() if len(each) == sum(one.set == x for one in plan())}
    heads, parts = [f"`{name.partition('/')[2]}`" for name in sets], []
    for kind, (measure, scale, digits) in kinds.items():
        rows = []
        for estimator in ESTIMATORS:
            pairs = [(values_of(each), estimates_of(each, estimator)) for each in sets.values()]
            found = ["–" if x is None else number(measure(true, x) / scale, digits) for true, x in pairs]
            rows.append([NAMES[estimator], *found])
        parts.append(table([kind, *heads], rows))
    chance = (number(chance_regret(values_of(each), 1) / 100.0) for each in sets.values())
    return "\n\n".join(parts) + f"\n| chance | {' | '.join(chance)} |"


def block(lines: Sequence[Line]) -> str:
    """All tables, with the intervals."""
    errors = [line.value.standard_error or 0.0 for line in lines]
    parts = [
        f"{len(lines)} of {len(plan())} target policies are done. Returns are divided by 100; the standard "
        f"errors of the true values are at most {max(errors) / 100:.2f}."
    ]
    for name in SETS:
        policies, planned = of(lines, name), [one for one in plan() if one.set == name]
        parts.append(f"### Estimators on `{name}`")
        if len(policies) < len(planned):
            parts.append(f"{len(policies)} of {len(planned)} target policies are done; measures need all.")
            continue
        values = values_of(policies) / 100
        low, middle, high = map(number, np.quantile(values, [0.0, 0.5, 1.0]))
        one, five = (number(chance_regret(values, k)) for k in CHOSEN)
        parts.append(f"True values: {low} to {high}, median {middle}. Regret of chance: {one} and {five}.")
        parts.append(measures(policies))
    parts += [
        "### Importance weights",
        "Medians of the effective number of episodes, by the number of steps. The last two columns say how "
        "many of the 95 % intervals of the estimates contain the true value.",
        weights(lines),
    ]
    return "\n\n".join(parts)


def write_page(lines: Sequence[Line]) -> None:
    """Write the tables: those with intervals beside the page."""
    write_measured(HERE / "selection.md", f"\n{shown(lines)}\n", "measured, selection")
    beside = json.dumps(block(lines).splitlines(), indent=1, ensure_ascii=False)
    (HERE / "policy-selection.json").write_text(beside + "\n", encoding="utf-8")
