"""What an evaluation returns, and the scores in it."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Iterator, Sequence
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ibdata._numerics.arrays import Floats
from ibdata._numerics.confidence import mean_estimate
from ibdata._numerics.naming import exact
from ibdata.dataset.reference_returns import EXPERT, HUNDRED, ZERO
from ibdata.dataset.tabular import Table, Tabular
from ibdata.evaluation.algorithms import (
    ENDS,
    Algorithm,
    LineReturns,
    columns_by_setpoint,
    differences_printed,
    estimated,
    printed,
)
from ibdata.evaluation.algorithms import Difference as Difference
from ibdata.evaluation.play import Played
from ibdata.policies import POLICIES, Policy

if TYPE_CHECKING:
    import pandas as pd


OF_COSTS = ("mean_cost", "cost_error", "violations")  # are shown if the view has a cost
WIDE = ("interval", "clipped", "expert_score")  # are shown by `results`, `to_pandas` and --json only
# Columns that are left out, the first ones first, where a terminal has no room for them.
LEAST_NEEDED = ("episodes", "mean_reward", "p10", "cost_error", "score_error", "standard_error")


class Result(NamedTuple):
    """The returns of a policy at a setpoint, discounted and unscaled. Errors are None for one episode.

    Attributes:
        policy: the label of the policy.
        setpoint: the setpoint; None for all setpoints with equal weights.
        episodes: the number of episodes.
        mean_return: the mean of their returns.
        standard_error: the standard error of `mean_return`.
        interval: the 95 % interval of `mean_return`, by Student's t.
        p10: the 10th percentile of the returns.
        mean_reward: the mean reward of a step, undiscounted.
        score: 0 for the mean return of `random`, 100 for that of `optimized`, in the same episodes.
        score_error: the standard error of `score`, which includes the errors of its two ends.
        expert_score: as `score`, but 100 for the mean return of `expert`.
        clipped: the share of the actions of which a number was outside [-1, 1] and clipped.
        mean_cost: the mean number of steps of an episode that cost 1; None if the view has no cost.
        cost_error: the standard error of `mean_cost`.
        violations: the share of the episodes with more such steps than the budget.
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


@dataclasses.dataclass(frozen=True, repr=False)
class Evaluation(Tabular):
    """Results per policy and setpoint, paired differences of the policies, and the returns behind both.

    Attributes:
        results: a `Result` for each policy and setpoint and, of several setpoints, for all together.
        differences: a `Difference` for each pair of policies, in the same order.
        scale: what scores mean.
        returns: the returns (policies, setpoints, episodes).
        steps: the number of steps of an episode.
        discount: the discount factor.
        notes: which set was compared, why errors or scores are missing and what may be wrong with a policy,
            a line for each.
        algorithms: an `Algorithm` for each label, beside known policies and the algorithms of the set.
        settings: the arguments that make the episodes.
        groups: the policies under each label.
    """

    results: list[Result]
    differences: list[Difference]
    scale: str | None
    returns: Floats
    steps: int
    discount: float
    notes: list[str]
    algorithms: list[Algorithm]
    settings: dict[str, Any]
    groups: dict[str, dict[str, Policy]]

    def save(self, path: str | os.PathLike[str], overwrite: bool = False) -> Path:
        """Write the table to a file, in the format of its ending.

        Args:
            path: where to write: .tex (a LaTeX table that needs booktabs), .md, .csv, or .json, which
                `ibdata evaluate --again` plays again.
            overwrite: replace a file that exists.

        Returns:
            The path.

        Raises:
            UsageError: the ending is another one, or the file exists.
        """
        from ibdata.evaluation import saving

        place = saving.place_of(path, overwrite)
        saving.save(self, place)
        return place

    @property
    def said(self) -> list[str]:
        """What scores mean, and the notes."""
        protocol = f"{self.steps} steps, discount {self.discount:g}"
        return [*([f"score: {self.scale}: {protocol}"] if self.scale else []), *self.notes]

    @property
    def compares(self) -> bool:
        """Whether algorithms are compared: with those of a set, or because a label has several seeds."""
        return self.settings["against"] is not None or len(self.groups) < len(self.returns)

    def tables(self, wide: bool = False) -> list[Table]:
        """Algorithms that are compared, or results; and differences. A terminal has no room for `wide`."""
        has_costs = any(result.mean_cost is not None for result in self.results)
        shown = [_shown(self.results, wide)] if wide or has_costs or not self.compares else []
        if self.compares:
            table = printed(self.algorithms, wide)
            shown.append(table if wide else table.fitting("score", *ENDS))
            if differences := [x for x in self.differences if wide or x.minus in self.groups]:
                shown.append(differences_printed(differences))
        elif self.differences:
            shown.append(_shown(self.differences, wide))
        at = -1 if self.compares else 0
        shown[at] = shown[at]._replace(notes=self.said)
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
            "algorithms": [each._asdict() for each in self.algorithms],
        }


def _shown(rows: Sequence[Result | Difference], wide: bool) -> Table:
    """All rows, in the columns for which a terminal has room, or in all."""
    hidden = () if wide else WIDE
    hidden = (
        hidden if any(getattr(row, "mean_cost", None) is not None for row in rows) else (*hidden, *OF_COSTS)
    )
    names = [name for name in rows[0]._fields if name not in hidden]
    cells = [{**row._asdict(), **({"setpoint": "all"} if row.setpoint is None else {})} for row in rows]
    table = Table(names, [[row[name] for name in names] for row in cells], most=None)
    return table if wide else table.fitting(*LEAST_NEEDED)


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
        for p, columns in columns_by_setpoint(setpoints):
            score = overall([scored[i][column] for column in columns]) if p is None else scored[i][columns[0]]
            values = list(returns[columns])
            p10, reward = float(np.quantile(values, 0.1)), mean_estimate(list(rewards[columns] / steps)).mean
            size, share = returns[columns].size, float(clipped[columns].mean())
            costs = played.costs[i, columns]
            over = [] if budget is None else [*mean_estimate(list(costs))[:2], float((costs > budget).mean())]
            results.append(Result(label, p, size, *mean_estimate(values), p10, reward, *score, share, *over))
    return results


def differences_of(
    groups: Sequence[LineReturns],
    others: Sequence[LineReturns],
    setpoints: Sequence[float],
    of_algorithms: bool,
) -> list[Difference]:
    """The differences of every two groups, and of each from the others, at each setpoint and over all."""
    pairs = [(b, a, a.label) for a, b in combinations(groups, 2)]
    pairs += [
        (group, other, f"{other.label} ({other.source})")
        for group in groups
        for other in others
        if len(other.returns)
    ]
    return [
        Difference(policy.label, name, p, *estimated(policy.at(columns), minus.at(columns), of_algorithms))
        for policy, minus, name in pairs
        for p, columns in columns_by_setpoint(setpoints)
    ]


SCALE = f"0 = {ZERO}, 100 = {HUNDRED}, simulated in the same episodes"
REFERENCES = (ZERO, HUNDRED, EXPERT)
CLEARLY = 2.0  # standard errors by which the policy of 100 must be better than that of 0


class Scores(NamedTuple):
    """What a policy scores; None where there is no scale or, for the error, one episode only."""

    score: float | None = None
    score_error: float | None = None
    expert_score: float | None = None


def with_references(
    policies: Sequence[Policy], dynamics: str, kinds: Sequence[str] = REFERENCES
) -> tuple[list[Policy], list[int]]:
    """Policies and the reference policies that they lack, and the places of the reference policies.

    The expert is the one that is made for the published dynamics of this name.
    """
    played, places = list(policies), []
    for kind in kinds:
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


def mean_scores(
    group: LineReturns, setpoints: Sequence[float], references: Floats
) -> dict[float | None, Any]:
    """The mean score of the trainings of a line, by setpoint; None over all of them."""
    by_training, found = scores(group.returns, references), {}
    for p, columns in columns_by_setpoint(setpoints):
        each = [overall([row[column] for column in columns]).score for row in by_training]
        known = [score for score in each if score is not None]
        found[p] = math.fsum(known) / len(known) if known and len(known) == len(each) else None
    return found


def _between(returns: Floats, low: Floats, high: Floats) -> tuple[float | None, float | None]:
    """The score of returns (n,) and its standard error, that of a ratio of paired means (delta method)."""
    gain, range_ = returns - low, high - low
    mean, error, _ = mean_estimate([range_])
    if mean <= CLEARLY * (error or 0.0):
        return None, None
    share = mean_estimate([gain]).mean / mean
    residual = mean_estimate([gain - share * range_]).standard_error
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
