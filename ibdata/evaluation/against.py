"""The shipped baselines of a set, for comparison with policies in the same episodes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.errors import UsageError, suggestion
from ibdata.evaluation.baselines import SETTINGS, Baseline, shipped_baselines
from ibdata.experiment.scenario import Scenario
from ibdata.numerics.confidence import estimate
from ibdata.numerics.naming import exact
from ibdata.views.options import ViewOptions

Floats = npt.NDArray[np.float64]


class Comparison(NamedTuple):
    """A policy against those that an algorithm learned from a set, or the set's behaviour.

    `mean_return` is over the seeds whose policy did not fail, `lowest` and `highest` are the mean returns of
    single seeds; all are discounted and unscaled. `mean_difference` is the return of `policy` minus the mean
    over the seeds, paired by episodes; its errors are those of the episodes, for these trained policies.
    """

    set: str
    algorithm: str
    seeds: int
    mean_return: float | None
    lowest: float | None
    highest: float | None
    policy: str
    mean_difference: float | None
    standard_error: float | None
    interval: tuple[float, float] | None


def baselines_of(name: str, scenario: Scenario, discount: float, view: ViewOptions) -> list[Baseline]:
    """The shipped baselines of a set, given with or without its suite.

    Raises UsageError if there are none, or if they were not evaluated in the episodes of this scenario.
    """
    lines = shipped_baselines()
    sets = list(dict.fromkeys(line.set for line in lines))
    last = [path.partition("/")[2] for path in sets]
    short = {path: end if last.count(end) == 1 else path for path, end in zip(sets, last, strict=True)}
    chosen = next((path for path in sets if name in (path, short[path])), None)
    if chosen is None:
        known = ", ".join(short.values())
        raise UsageError(
            f"--against: found {name!r}, expected one of {known}{suggestion(name, short.values())}"
        )
    if view.reward.kind != "classic":
        raise UsageError(f"--reward: found {view.reward.kind}, expected classic: --against compares with it")
    _refuse_other_episodes(scenario, discount)
    return [line for line in lines if line.set == chosen]


def compared(lines: list[Baseline], labels: list[str], returns: Floats) -> list[Comparison]:
    """Compare policies, by their returns (policies, episodes), with each algorithm in the lines of a set."""
    algorithms = dict.fromkeys(line.algorithm for line in lines)
    return [
        _comparison([line for line in lines if line.algorithm == algorithm], label, of_policy)
        for label, of_policy in zip(labels, returns, strict=True)
        for algorithm in algorithms
    ]


def _comparison(lines: list[Baseline], policy: str, returns: Floats) -> Comparison:
    """Compare a policy with one algorithm, whose seeds have these lines."""
    name, algorithm = lines[0].set, lines[0].algorithm
    values = [line.values for line in lines if line.values is not None]
    if not values:
        return Comparison(name, algorithm, 0, None, None, None, policy, None, None, None)
    means = [float(of_seed.mean()) for of_seed in values]
    mean, difference = sum(means) / len(means), estimate([returns - np.mean(values, axis=0)])
    return Comparison(name, algorithm, len(values), mean, min(means), max(means), policy, *difference)


def _refuse_other_episodes(scenario: Scenario, discount: float) -> None:
    [point, *others] = scenario.points
    settings = {
        "setpoint": "drifting" if scenario.drifting else scenario.points if others else point,
        "steps": scenario.steps,
        "discount": discount,
        "episodes": scenario.episodes,
        "start": scenario.start_form,
        "dynamics": scenario.dynamics,
        "seed": scenario.seed,
    }
    for name, expected in SETTINGS.items():
        if settings[name] != expected:
            every = ", ".join(f"{key} {_shown(value)}" for key, value in SETTINGS.items())
            raise UsageError(
                f"--{name}: found {_shown(settings[name])}, expected {_shown(expected)}: --against compares "
                f"with the returns of {every}"
            )


def _shown(value: object) -> str:
    return exact(value) if isinstance(value, float) else str(value)
