"""Why an evaluation has no errors or no scores."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ibdata.dataset import reference_returns
from ibdata.experiment import Experiment
from ibdata.numerics.naming import exact
from ibdata.views.options import PLAIN, ViewOptions


def notes(
    experiment: Experiment,
    setpoints: list[float],
    scale: reference_returns.Scale | None,
    view: ViewOptions = PLAIN,
) -> Iterator[str]:
    """Yield a line for each reason, of episodes at these setpoints with this scale of scores."""
    if experiment.episodes == 1:
        yield "no standard error: one episode per policy and setpoint has none"
    if experiment.drifting:
        yield "no score: drifting setpoints have none"
        return
    if view.reward.kind != "classic":
        yield "no score: there are reference returns only for the classic reward"
        return
    if scale is None:
        scales = reference_returns.reference().scales
        known = (
            f"the dynamics {', '.join(dict.fromkeys(s.dynamics for s in scales))}",
            f"the starts {', '.join(dict.fromkeys(_as_yaml(s.start) for s in scales))}",
            ", ".join(dict.fromkeys(f"{s.steps} steps with discount {s.discount:g}" for s in scales)),
        )
        yield f"no score: there are reference returns only for {'; '.join(known)}"
        return
    scored = [r.setpoint for r in scale.results if scale.score(r.setpoint, 0.0) is not None]
    missing = [p for p in setpoints if p not in scored]
    if missing:
        everywhere = "" if len(setpoints) == 1 else ", and so none over all setpoints"
        at = ", ".join(map(exact, sorted(set(scored))))
        yield (
            f"no score at setpoint {', '.join(map(exact, missing))}{everywhere}: there are "
            f"reference returns at {at}"
        )


def _as_yaml(start: Any) -> str:
    """A start as an experiment has it."""
    return start if isinstance(start, str) else "{{burn_in: {burn_in}}}".format(**start)
