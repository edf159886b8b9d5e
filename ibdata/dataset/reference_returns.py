"""Measured returns of reference policies, and the scales of scores.

A score is 0 for `random` and 100 for `optimized`; an expert score is 0 for `random` and 100 for `expert`.

studies/reference-returns makes `reference_returns.json`, in which a list of values stands for a `Measured`.
Reading it needs neither the simulator nor a policy.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from ibdata.dataset.models import Info, JsonObject

FILE = Path(__file__).with_name("reference_returns.json")
ZERO, HUNDRED, EXPERT = "random", "optimized", "expert"
SIGMAS = 5.0


class Measured(NamedTuple):
    """The measured returns of a policy at a setpoint, or from the first value of a moving one."""

    policy: str
    setpoint: float
    mean_return: float
    standard_error: float
    interval: list[float]  # of 95 % confidence
    p10: float
    mean_reward: float


class Scale(JsonObject):
    """The returns of the reference policies under one dynamics, start, number of steps and discount."""

    dynamics: str
    start: str | dict[str, list[int]]  # as in an experiment
    steps: int
    discount: float
    episodes: int
    drifting: bool = False  # whether the setpoints move; if so, those of the results are first values
    results: list[Measured]

    @property
    def text(self) -> str:
        """The meaning of a score."""
        setpoint = "first value of the moving setpoint" if self.drifting else "setpoint"
        if isinstance(self.start, str):
            start = f"{self.start} start"
        else:
            start = "start after {} to {} random steps".format(*self.start["burn_in"])
        return (
            f"0 = {ZERO}, 100 = {HUNDRED}, at the same {setpoint}: "
            f"{self.dynamics} dynamics, {start}, {self.steps} steps, discount {self.discount:g}"
        )

    def ends(self, setpoints: Sequence[float], top: str = HUNDRED) -> tuple[float, float] | None:
        """The returns that score 0 and 100, each the mean over some setpoints; `top` is the policy of 100.

        None if the scale does not have one of the setpoints, or if the upper end is not above the lower one
        by more than five standard errors of their difference.
        """
        known = {(r.policy, r.setpoint): r for r in self.results}
        pairs = [(known.get((ZERO, p)), known.get((top, p))) for p in setpoints]
        both = [(low, high) for low, high in pairs if low is not None and high is not None]
        if len(both) < len(pairs):
            return None
        n = len(both)
        low, high = (math.fsum(r.mean_return for r in end) / n for end in zip(*both, strict=True))
        error = math.hypot(*(r.standard_error for pair in both for r in pair)) / n
        return (low, high) if high - low > SIGMAS * error else None

    def score(self, setpoint: float, mean_return: float, top: str = HUNDRED) -> float | None:
        """Convert a mean return to a score; None if `ends` has none at the setpoint."""
        ends = self.ends([setpoint], top)
        if ends is None:
            return None
        low, high = ends
        return 100.0 * (mean_return - low) / (high - low)


class Reference(JsonObject):
    """All of `reference_returns.json`."""

    version: int
    made_by: str
    scales: list[Scale]


@cache
def reference() -> Reference:
    """The reference returns, read once."""
    return Reference.model_validate_json(FILE.read_bytes())


def scale(dynamics: Any, start: Any, steps: int, discount: float, *, drifting: bool = False) -> Scale | None:
    """The scale for exactly these dynamics, start, steps and discount; None if there is none.

    Moving setpoints have scales of their own, since constant ones are other tasks.
    """
    key = (dynamics, start, steps, discount, drifting)
    scales = (s for s in reference().scales if (s.dynamics, s.start, s.steps, s.discount, s.drifting) == key)
    return next(scales, None)


def scale_of(info: Info, steps: int) -> Scale | None:
    """The scale for the undiscounted returns of a dataset's episodes with this number of steps."""
    return scale(info.dynamics, info.start, steps, 1.0, drifting=info.drifting)
