"""Scores of policies: 0 for random actions, 100 for a stated formula, played in the same episodes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.dataset.reference_returns import EXPERT, HUNDRED, ZERO
from ibdata.numerics.confidence import estimate
from ibdata.numerics.naming import exact
from ibdata.policies import POLICIES, Policy

Floats = npt.NDArray[np.float64]
SCALE = f"0 = {ZERO}, 100 = {HUNDRED}, or {EXPERT} for the expert score, simulated in the same episodes"
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
        forms = [policy.form() for policy in played]
        if reference.form() not in forms:
            played.append(reference)
            forms.append(reference.form())
        places.append(forms.index(reference.form()))
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
