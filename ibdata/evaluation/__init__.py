"""Evaluation of policies: returns of new episodes, with standard errors, on common random numbers."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.dataset import reference_returns
from ibdata.errors import UsageError
from ibdata.evaluation.play import returns
from ibdata.evaluation.policies import policy_of
from ibdata.experiment import Experiment, validated
from ibdata.numerics.confidence import estimate
from ibdata.system.memory import refuse_too_much

Floats = npt.NDArray[np.float64]
RETURN_BYTES = 16  # least memory per episode, for two sums


class Result(NamedTuple):
    """Returns of a policy at a setpoint, or over all setpoints (None) with equal weights.

    `mean_return` with its standard error and 95 % interval, and `p10`, the 10th percentile of the returns,
    are discounted and unscaled. `mean_reward` is per step and undiscounted. `Evaluation.scale` explains
    `score`.
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


class Difference(NamedTuple):
    """The returns of `policy` minus those of `less` in equal episodes, at a setpoint or over all (None)."""

    policy: str
    less: str
    setpoint: float | None
    mean_difference: float
    standard_error: float | None
    interval: tuple[float, float] | None


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """Results per policy and setpoint, paired differences of the policies, and the returns behind both."""

    results: list[Result]
    differences: list[Difference]
    scale: str | None
    returns: Floats  # (policies, setpoints, episodes)

    def plain(self) -> dict[str, Any]:
        """Results, differences and scale as plain data."""
        return {
            "results": [result._asdict() for result in self.results],
            "differences": [difference._asdict() for difference in self.differences],
            "scale": self.scale,
        }


def evaluate(
    policy: Any,
    setpoint: float | Sequence[float] | str | dict[str, Any] = 70.0,
    *,
    steps: int = 100,
    discount: float = 0.97,
    episodes: int = 100,
    start: Any = "default",
    dynamics: Any = "siemens",
    seed: int = 0,
    history: int = 1,
    allow_code: bool = False,
) -> Evaluation:
    """Simulate new episodes with one or several policies and compare their returns.

    The environment uses the same random numbers for all policies, so their differences are paired, episode by
    episode. The return of an episode is the sum over t of discountᵗ times the reward.

    Args:
        policy: a kind such as "optimized", a block (mapping, YAML text or file), a `Policy`, or any object
            with `act(history, u)` or `predict(observation)`; or a list of them.
        setpoint: one or several numbers; "drifting", or {"drifting": [50, 70]} for the values at the start.
            There is no score for drifting setpoints.
        steps: steps per episode.
        discount: the discount factor, in [0, 1].
        episodes: episodes per policy and setpoint.
        start: the start state, as in an experiment.
        dynamics: the dynamics, as in an experiment.
        seed: the seed of all random numbers.
        history: the number of observations that an object without `history_length` sees. `predict` gets them
            newest first, flattened to (n, 6 · history).
        allow_code: whether a custom policy that a file names may run.

    Returns:
        Results per policy and setpoint, and the paired differences of the policies.

    Raises:
        UsageError, ConfigError: an argument is invalid.
        PolicyError: a policy failed, or returned no valid action.
    """
    if not 0.0 <= discount <= 1.0:
        raise UsageError(f"discount: found {discount}, expected a number in [0, 1]")
    if history < 1:
        raise UsageError(f"history: found {history}, expected at least 1")
    given = policy if isinstance(policy, list | tuple) else [policy]
    policies = [policy_of(p, history, allow_code) for p in given]
    if not policies:
        raise UsageError("policy: found none, expected at least one")
    if isinstance(episodes, int):
        refuse_too_much("episodes", RETURN_BYTES * len(policies) * episodes)
    plain = {
        "name": "evaluate",
        "setpoints": list(setpoint) if isinstance(setpoint, tuple) else setpoint,
        "dynamics": dynamics,
        "policies": [{"kind": "random"}],
    }
    settings = {"start": start, "steps": steps, "episodes": episodes, "seed": seed}
    options = validated({**plain, **settings}).options()
    experiment = Experiment.model_construct(**{**options, "policies": policies})  # of any class
    discounted, undiscounted = returns(experiment, float(discount))
    scale = None
    if not experiment.drifting:
        scale = reference_returns.scale(experiment.dynamics, experiment.cells[0].start, steps, discount)
    points = [cell.setpoint for cell in experiment.cells[: discounted.shape[1]]]
    results: list[Result] = []
    labels = experiment.labels
    for i, label in enumerate(labels):
        rows = [
            _result(label, p, discounted[i, j : j + 1], undiscounted[i, j] / steps, scale)
            for j, p in enumerate(points)
        ]
        results += rows
        if len(rows) > 1:
            results.append(_overall(label, rows, discounted[i]))
    differences = [
        _difference(labels[b], labels[a], p, discounted[b, part] - discounted[a, part])
        for a, b in combinations(range(len(labels)), 2)
        for p, part in _parts(points)
    ]
    return Evaluation(results, differences, scale.text if scale else None, discounted)


def _parts(setpoints: list[float]) -> list[tuple[float | None, slice]]:
    """Each setpoint and, if there are several, None for all, with its slice."""
    every: list[tuple[float | None, slice]] = [(p, slice(j, j + 1)) for j, p in enumerate(setpoints)]
    return every if len(every) == 1 else [*every, (None, slice(None))]


def _result(
    label: str, setpoint: float, values: Floats, rewards: Floats, scale: reference_returns.Scale | None
) -> Result:
    found = estimate(list(values))
    score = scale.score(setpoint, found.mean) if scale else None
    reward = estimate([rewards]).mean
    return Result(label, setpoint, values.size, *found, float(np.quantile(values, 0.1)), reward, score)


def _overall(label: str, rows: list[Result], values: Floats) -> Result:
    """The result over all setpoints. Its score is the mean of their scores, if each has one."""
    scores = [row.score for row in rows if row.score is not None]
    score = sum(scores) / len(rows) if len(scores) == len(rows) else None
    reward = sum(row.mean_reward for row in rows) / len(rows)
    p10 = float(np.quantile(values, 0.1))
    return Result(label, None, values.size, *estimate(list(values)), p10, reward, score)


def _difference(label: str, less: str, setpoint: float | None, values: Floats) -> Difference:
    return Difference(label, less, setpoint, *estimate(list(values)))
