"""What an evaluation returns, and the scores in it."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata._numerics.confidence import estimate
from ibdata._numerics.naming import exact
from ibdata.dataset.reference_returns import EXPERT, HUNDRED, ZERO
from ibdata.dataset.tabular import Table, Tabular
from ibdata.evaluation.baselines import Comparison
from ibdata.evaluation.play import Played
from ibdata.policies import POLICIES, Policy

if TYPE_CHECKING:
    import pandas as pd

Floats = npt.NDArray[np.float64]

OF_COSTS = ("mean_cost", "cost_error", "violations")  # are shown if the view has a cost
WIDE = ("interval", "clipped", "expert_score")  # are shown by `results`, `to_pandas` and --json only


class Result(NamedTuple):
    """Returns of a policy at a setpoint, or over all setpoints (None) with equal weights.

    `mean_return` with its standard error and 95 % interval, and `p10`, the 10th percentile of the returns,
    are discounted and unscaled. `mean_reward` is per step and undiscounted. `score` is 0 for `random` and
    100 for `optimized` in the same episodes, `expert_score` is 100 for `expert`; `score_error` is the
    standard error of `score`, with that of the scale. `clipped` is the share of the actions that were clipped
    to [-1, 1]. If the view has a cost, `mean_cost` is the mean number of steps that cost 1 with its
    `cost_error`, and `violations` the share of the episodes with more of them than the budget. Errors are
    None for one episode.
    """

    policy: str
    setpoint: float | None
    episodes: int
    mean_return: float
    standard_error: float | None
    interval: tuple[float, float] | None
    p10: float
    mean_reward: float
    score: float | None
    score_error: float | None
    expert_score: float | None
    clipped: float
    mean_cost: float | None = None
    cost_error: float | None = None
    violations: float | None = None


class Difference(NamedTuple):
    """The returns of `policy` minus those of `minus` in equal episodes, at a setpoint or over all (None)."""

    policy: str
    minus: str
    setpoint: float | None
    mean_difference: float
    standard_error: float | None
    interval: tuple[float, float] | None


@dataclasses.dataclass(frozen=True, repr=False)
class Evaluation(Tabular):
    """Results per policy and setpoint, paired differences of the policies, and the returns behind both.

    `scale` says what scores mean, and `notes` which baselines were compared, why errors or scores are missing
    and what may be wrong with a policy, a line for each. `baselines` compares the policies with the shipped
    results on a set.
    """

    results: list[Result]
    differences: list[Difference]
    scale: str | None
    returns: Floats  # (policies, setpoints, episodes)
    steps: int
    discount: float
    notes: list[str]
    baselines: list[Comparison] = dataclasses.field(default_factory=list)

    def tables(self) -> list[Table]:
        """The results and, if there are several policies, their differences; without what is wide."""
        protocol = f"{self.steps} steps, discount {self.discount:g}"
        said = [*([f"score: {self.scale}: {protocol}"] if self.scale else []), *self.notes]
        shown = [_shown(Result._fields, self.results, said)]
        if self.baselines:
            names = [name for name in Comparison._fields if name not in WIDE]
            rows = [[getattr(row, name) for name in names] for row in self.baselines]
            shown.append(Table(names, rows))
        if self.differences:
            shown.append(_shown(Difference._fields, self.differences))
        return shown

    def to_pandas(self) -> pd.DataFrame:
        """The results, a row each, as a pandas DataFrame; the setpoint is missing where it means all."""
        import pandas as pd

        return pd.DataFrame(self.results, columns=list(Result._fields))

    def plain(self) -> dict[str, Any]:
        """Everything but the returns of single episodes, as plain data."""
        return {
            "results": [result._asdict() for result in self.results],
            "differences": [difference._asdict() for difference in self.differences],
            "scale": self.scale,
            "steps": self.steps,
            "discount": self.discount,
            "notes": self.notes,
            **({"baselines": [each._asdict() for each in self.baselines]} if self.baselines else {}),
        }


def _shown(names: Sequence[str], rows: Sequence[Result | Difference], notes: Sequence[str] = ()) -> Table:
    """A table for the width of a terminal."""
    hidden = WIDE if any(getattr(row, "mean_cost", None) is not None for row in rows) else (*WIDE, *OF_COSTS)
    names = [name for name in names if name not in hidden]
    cells = [{**row._asdict(), **({"setpoint": "all"} if row.setpoint is None else {})} for row in rows]
    return Table(names, [[row[name] for name in names] for row in cells], notes)


def results_of(
    labels: Sequence[str],
    setpoints: Sequence[float],
    played: Played,
    scored: Sequence[Sequence[Scores]],
    steps: int,
    budget: float | None = None,
) -> list[Result]:
    """The result of each policy at each setpoint and, if there are several, over all."""
    results = []
    for i, label in enumerate(labels):
        returns, rewards, clipped = played.discounted[i], played.undiscounted[i], played.clipped[i]
        parts: list[tuple[float | None, list[int], Scores]] = [
            (p, [j], scored[i][j]) for j, p in enumerate(setpoints)
        ]
        if len(setpoints) > 1:
            parts.append((None, list(range(len(setpoints))), overall(scored[i])))
        for p, columns, score in parts:
            values = list(returns[columns])
            p10, reward = float(np.quantile(values, 0.1)), estimate(list(rewards[columns] / steps)).mean
            size, share = returns[columns].size, float(clipped[columns].mean())
            costs = played.costs[i, columns]
            over = [] if budget is None else [*estimate(list(costs))[:2], float((costs > budget).mean())]
            results.append(Result(label, p, size, *estimate(values), p10, reward, *score, share, *over))
    return results


def differences_of(labels: Sequence[str], setpoints: Sequence[float], returns: Floats) -> list[Difference]:
    """The paired differences of every two policies at each setpoint and, if there are several, over all."""
    parts: list[tuple[float | None, list[int]]] = [(p, [j]) for j, p in enumerate(setpoints)]
    if len(setpoints) > 1:
        parts.append((None, list(range(len(setpoints)))))
    return [
        Difference(labels[b], labels[a], p, *estimate(list(returns[b, columns] - returns[a, columns])))
        for a, b in combinations(range(len(labels)), 2)
        for p, columns in parts
    ]


SCALE = f"0 = {ZERO}, 100 = {HUNDRED}, simulated in the same episodes"
REFERENCES = (ZERO, HUNDRED, EXPERT)
CLEARLY = 2.0  # standard errors by which the policy of 100 must be better than that of 0


class Scores(NamedTuple):
    """What a policy scores; None where there is no scale or, for the error, one episode only."""

    score: float | None = None
    score_error: float | None = None
    expert_score: float | None = None


def with_references(policies: Sequence[Policy], dynamics: str) -> tuple[list[Policy], list[int]]:
    """Policies and the reference policies that they lack, and the places of the three reference policies.

    The expert is the one that is made for the published dynamics of this name.
    """
    played, places = list(policies), []
    for kind in REFERENCES:
        options = {"dynamics": dynamics} if kind == EXPERT else {}
        reference = POLICIES[kind].model_validate({"kind": kind, **options})
        same = [i for i, policy in enumerate(played) if policy.is_same(reference)]
        places.append(same[0] if same else len(played))
        played += [] if same else [reference]
    return played, places


def scores(returns: Floats, references: Floats) -> list[list[Scores]]:
    """The scores of each policy at each setpoint, from returns (policies, setpoints, episodes).

    The references (3, setpoints, episodes) have those of the reference policies, or there are none (0).
    """
    if not len(references):
        return [[Scores()] * returns.shape[1]] * len(returns)
    zero, hundred, expert = references
    return [
        [
            Scores(*_between(at_setpoint, zero[j], hundred[j]), _between(at_setpoint, zero[j], expert[j])[0])
            for j, at_setpoint in enumerate(of_policy)
        ]
        for of_policy in returns
    ]


def overall(at_setpoints: Sequence[Scores]) -> Scores:
    """The mean scores over setpoints; None where one is missing."""
    values, errors, experts = (
        [x for x in column if x is not None] for column in zip(*at_setpoints, strict=True)
    )
    n = len(at_setpoints)
    return Scores(
        sum(values) / n if len(values) == n else None,
        float(np.sqrt(np.square(errors).sum())) / n if len(errors) == n else None,
        sum(experts) / n if len(experts) == n else None,
    )


def _between(returns: Floats, low: Floats, high: Floats) -> tuple[float | None, float | None]:
    """The score of returns (n,) and its standard error, that of a ratio of paired means (delta method)."""
    gain, range_ = returns - low, high - low
    mean, error, _ = estimate([range_])
    if mean <= CLEARLY * (error or 0.0):
        return None, None
    share = estimate([gain]).mean / mean
    residual = estimate([gain - share * range_]).standard_error
    return 100.0 * share, None if residual is None else 100.0 * residual / mean


def notes(
    episodes: int, setpoints: Sequence[float], scored: Sequence[Scores], classic: bool
) -> Iterator[str]:
    """Why errors or scores of a policy at these setpoints are missing, a line for each reason."""
    if episodes == 1:
        yield "no standard error: one episode per policy and setpoint has none"
    if not classic:
        yield f"no score: {HUNDRED} is made for the classic reward"
        return
    missing = [p for p, score in zip(setpoints, scored, strict=True) if score.score is None]
    if missing:
        everywhere = "" if len(setpoints) == 1 else ", and so none over all setpoints"
        yield (
            f"no score at setpoint {', '.join(map(exact, missing))}{everywhere}: {HUNDRED} is not clearly "
            f"better than {ZERO} in these episodes"
        )
