"""Evaluation of policies: returns of new episodes, with standard errors, on common random numbers."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.dataset import reference_returns
from ibdata.dataset.reference_returns import EXPERT, HUNDRED
from ibdata.errors import ConfigError, UsageError
from ibdata.evaluation.against import baselines_of, results_of
from ibdata.evaluation.baselines import SETTINGS
from ibdata.evaluation.discount import checked_discount
from ibdata.evaluation.notes import notes
from ibdata.evaluation.play import Played, episodes_of
from ibdata.evaluation.policies import Acting, policies_of
from ibdata.evaluation.results import Difference as Difference
from ibdata.evaluation.results import Evaluation as Evaluation
from ibdata.evaluation.results import Result as Result
from ibdata.experiment import Experiment, validated
from ibdata.experiment.plain import plain
from ibdata.numerics.confidence import Estimate, estimate
from ibdata.system.memory import refuse_too_much
from ibdata.system.progress import bar
from ibdata.views.options import View, view_of

Floats = npt.NDArray[np.float64]
RETURN_BYTES = 16  # least memory per episode, for two sums


def evaluate(
    policy: Any,
    setpoint: float | Sequence[float] | str | dict[str, Any] = 70.0,
    *,
    steps: int = 100,
    discount: float = 0.97,
    episodes: int | None = None,
    start: Any = "default",
    dynamics: Any = "siemens",
    seed: int = 0,
    history: int | Mapping[str, int] = 1,
    allow_code: bool = False,
    against: str | None = None,
    progress: bool | None = False,
    view: View = None,
) -> Evaluation:
    """Simulate new episodes with one or several policies and compare their returns.

    The environment uses the same random numbers for all policies, so their differences are paired, episode by
    episode. The return of an episode is the sum over t of discountᵗ times the reward.

    Args:
        policy: one of the following, a mapping of labels to them, or a list of both: a kind such as
            "optimized", a block (mapping, YAML text or file), a `Policy`, an object with `decide(given)`,
            `act(history, u)` or `predict(observations)`, a `torch.nn.Module`, or any other callable. Modules
            and callables are called as `predict` is: on float32 observations (n, 6 · history), newest first,
            for actions (n, 3). Modules get a tensor, in evaluation mode and without gradients. An object may
            remember and draw as a custom policy may (docs/policies.md).
        setpoint: one or several numbers, by default 70; "drifting", or {"drifting": [50, 70]} for
            the values at the start. There is no score for drifting setpoints.
        steps: steps per episode.
        discount: the discount factor, in [0, 1].
        episodes: episodes per policy and setpoint, by default 100, or 200 with `against`.
        start: the start state, as in an experiment.
        dynamics: the dynamics, as in an experiment.
        seed: the seed of all random numbers.
        history: the number of observations that an object sees, if it has no attribute `needs`:
            one number for all, or a mapping of labels to numbers; labels that it lacks get 1.
        allow_code: whether a custom policy that a file names may run.
        against: a shipped experiment, such as "optimized-40": its baselines (docs/baselines.md) are compared
            with the policies. The other arguments but `policy` must be the default ones.
        progress: whether to show a bar on stderr; None shows it if stderr is a terminal.
        view: what objects see, and the reward, as the options of a view (docs/views.md), without
            `reward_scale`. Policies of other kinds always see the six observed variables; there are scores
            only for the classic reward.

    Returns:
        Results per policy and setpoint, and the paired differences of the policies.

    Raises:
        UsageError, ConfigError: an argument is invalid.
        PolicyError: a policy failed, or returned no valid action.
    """
    discount = checked_discount(discount)
    policies = policies_of(policy, history, allow_code)
    options = view_of(view)
    if options.reward_scale != 1.0:
        raise UsageError("view: found reward_scale, but returns are not scaled; leave it out")
    if not options.is_classic and not any(isinstance(each, Acting) for each in policies.values()):
        raise UsageError(
            "view: found one, but no object that could see it: policies of ibdata see the six observed "
            "variables; leave it out, or give a function, a module or an object"
        )
    if not policies:
        raise UsageError("policy: found no policy, expected at least one")
    setpoint, start, steps, episodes, seed = plain([setpoint, start, steps, episodes, seed])
    if episodes is None:
        episodes = 100 if against is None else SETTINGS["episodes"]
    if isinstance(episodes, int):
        refuse_too_much("episodes", RETURN_BYTES * len(policies) * episodes)
    described = {
        "name": "evaluate",
        "setpoints": setpoint,
        "dynamics": dynamics,
        "policies": [{"kind": "random"}],
    }
    settings = {"start": start, "steps": steps, "episodes": episodes, "seed": seed}
    try:
        given = validated({**described, **settings}).options()
    except ConfigError as error:  # an experiment has `setpoints`, an evaluation `setpoint`
        lines = str(error).split("\n")
        raise ConfigError([re.sub("^setpoints", "setpoint", line) for line in lines]) from None
    labels = tuple(policies)
    experiment = Experiment.model_construct(**{**given, "policies": list(policies.values())})  # of any class
    vars(experiment)["labels"] = labels
    baselines = [] if against is None else baselines_of(against, experiment, discount, options)
    with bar(progress, experiment.rows, "steps") as advance:
        played = episodes_of(experiment, discount, advance, options)
    scale = None
    if not experiment.drifting and options.reward.kind == "classic":
        scale = reference_returns.scale(experiment.dynamics, experiment.cells[0].start, steps, discount)
    points = [cell.setpoint for cell in experiment.cells[: played.clipped.shape[1]]]
    results: list[Result] = []
    for i, label in enumerate(labels):
        rows = [_result(label, p, played, (i, j), steps, scale) for j, p in enumerate(points)]
        results += rows
        if len(rows) > 1:
            results.append(_overall(label, rows, played.discounted[i]))
    differences = [
        _difference(labels[b], labels[a], p, played.discounted[b, part] - played.discounted[a, part])
        for a, b in combinations(range(len(labels)), 2)
        for p, part in _parts(points)
    ]
    differences += [
        _difference(name, line.label, points[0], played.discounted[i] - line.values)
        for i, name in enumerate(labels)
        for line in baselines
        if line.values is not None
    ]
    text, missing = scale.text if scale else None, list(notes(experiment, points, scale, options))
    known = results_of(baselines)
    return Evaluation(results, differences, text, played.discounted, steps, discount, missing, known)


def _parts(setpoints: list[float]) -> list[tuple[float | None, slice]]:
    """Each setpoint and, if there are several, None for all, with its slice."""
    every: list[tuple[float | None, slice]] = [(p, slice(j, j + 1)) for j, p in enumerate(setpoints)]
    return every if len(every) == 1 else [*every, (None, slice(None))]


def _result(
    label: str,
    setpoint: float,
    played: Played,
    cell: tuple[int, int],
    steps: int,
    scale: reference_returns.Scale | None,
) -> Result:
    values = played.discounted[cell]
    found = estimate([values])
    reward = estimate([played.undiscounted[cell] / steps]).mean
    p10, clipped = float(np.quantile(values, 0.1)), float(played.clipped[cell])
    scores = _score(setpoint, found, scale)
    return Result(label, setpoint, values.size, *found, p10, reward, *scores, clipped)


def _score(
    setpoint: float, found: Estimate, scale: reference_returns.Scale | None
) -> tuple[float | None, float | None, float | None]:
    """The score, its standard error, and the expert score."""
    if scale is None:
        return None, None, None
    score, expert = (scale.score(setpoint, found.mean, top) for top in (HUNDRED, EXPERT))
    ends = scale.ends([setpoint])
    if ends is None or found.standard_error is None:
        return score, None, expert
    return score, 100.0 * found.standard_error / (ends[1] - ends[0]), expert


def _overall(label: str, rows: list[Result], values: Floats) -> Result:
    """The result over all setpoints. Its scores are the means of their scores, if each has one."""
    scores, experts = [row.score for row in rows], [row.expert_score for row in rows]
    errors = [row.score_error for row in rows if row.score_error is not None]
    error = math.hypot(*errors) / len(rows) if len(errors) == len(rows) else None
    reward, clipped = (
        sum(getattr(row, name) for row in rows) / len(rows) for name in ("mean_reward", "clipped")
    )
    p10 = float(np.quantile(values, 0.1))
    both = _mean(scores), error, _mean(experts)
    return Result(label, None, values.size, *estimate(list(values)), p10, reward, *both, clipped)


def _mean(scores: list[float | None]) -> float | None:
    """The mean of scores; None if one is missing."""
    known = [score for score in scores if score is not None]
    return sum(known) / len(scores) if len(known) == len(scores) else None


def _difference(label: str, less: str, setpoint: float | None, values: Floats) -> Difference:
    return Difference(label, less, setpoint, *estimate(list(values)))
