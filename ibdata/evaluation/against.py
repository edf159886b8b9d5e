"""The shipped baselines of a set, for comparison with policies in the same episodes."""

from __future__ import annotations

from typing import NamedTuple

from ibdata.errors import UsageError, suggestion
from ibdata.evaluation.baselines import SETTINGS, Baseline, shipped_baselines
from ibdata.experiment import Experiment
from ibdata.numerics.naming import exact
from ibdata.views.options import ViewOptions


class BaselineResult(NamedTuple):
    """The returns of a policy that an algorithm learned from a set, or of the set's behaviour (seed None).

    As in `Result`, they are discounted and unscaled. They are None if the policy failed.
    """

    set: str
    algorithm: str
    seed: int | None
    mean_return: float | None
    standard_error: float | None
    p10: float | None


def baselines_of(name: str, experiment: Experiment, discount: float, view: ViewOptions) -> list[Baseline]:
    """The shipped baselines of a set, given with or without its suite.

    Raises UsageError if there are none, or if they were not evaluated in the episodes of this experiment.
    """
    lines = shipped_baselines()
    sets = list(dict.fromkeys(line.set for line in lines))
    last = [each.partition("/")[2] for each in sets]
    short = {each: end if last.count(end) == 1 else each for each, end in zip(sets, last, strict=True)}
    found = next((each for each in sets if name in (each, short[each])), None)
    if found is None:
        known = ", ".join(short.values())
        raise UsageError(
            f"--against: found {name!r}, expected one of {known}{suggestion(name, short.values())}"
        )
    if view.reward.kind != "classic":
        raise UsageError(f"--reward: found {view.reward.kind}, expected classic: --against compares with it")
    _refuse_other_episodes(experiment, discount)
    return [line for line in lines if line.set == found]


def results_of(lines: list[Baseline]) -> list[BaselineResult]:
    """What is shown of baselines."""
    return [BaselineResult(*(getattr(line, name) for name in BaselineResult._fields)) for line in lines]


def _refuse_other_episodes(experiment: Experiment, discount: float) -> None:
    points = list(dict.fromkeys(cell.setpoint for cell in experiment.cells))
    setpoint: object = points[0] if len(points) == 1 else points
    found = {
        "setpoint": "drifting" if experiment.drifting else setpoint,
        "steps": experiment.steps,
        "discount": discount,
        "episodes": experiment.episodes,
        "start": experiment.cells[0].start,
        "dynamics": experiment.dynamics,
        "seed": experiment.seed,
    }
    for name, expected in SETTINGS.items():
        if found[name] != expected:
            every = ", ".join(f"{key} {_shown(value)}" for key, value in SETTINGS.items())
            raise UsageError(
                f"--{name}: found {_shown(found[name])}, expected {_shown(expected)}: --against compares "
                f"with the returns of {every}"
            )


def _shown(value: object) -> str:
    return exact(value) if isinstance(value, float) else str(value)
