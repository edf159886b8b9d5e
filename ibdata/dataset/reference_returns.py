"""Measured returns of reference policies, and the scale of scores: 0 for `random`, 100 for `optimized`.

scripts/reference-returns makes `reference_returns.json`. Reading it needs neither the simulator nor a policy.
"""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

from ibdata.dataset.models import JsonObject

FILE = Path(__file__).with_name("reference_returns.json")
ZERO, HUNDRED = "random", "optimized"
SIGMAS = 5.0


class Measured(JsonObject):
    """The measured returns of a policy at a setpoint."""

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
    start: str
    steps: int
    discount: float
    episodes: int
    results: list[Measured]

    @property
    def text(self) -> str:
        """The meaning of a score."""
        return (
            f"0 = {ZERO}, 100 = {HUNDRED} at the same setpoint: {self.dynamics} dynamics, default "
            f"start, {self.steps} steps, discount {self.discount:g}"
        )

    def score(self, setpoint: float, mean_return: float) -> float | None:
        """Convert a mean return to a score.

        None if the scale does not have the setpoint, or if its upper end is not above the lower one by more
        than five standard errors of their difference.
        """
        ends = {r.policy: r for r in self.results if r.setpoint == setpoint}
        if not {ZERO, HUNDRED} <= ends.keys():
            return None
        low, high = ends[ZERO], ends[HUNDRED]
        width = high.mean_return - low.mean_return
        if width <= SIGMAS * math.hypot(low.standard_error, high.standard_error):
            return None
        return 100.0 * (mean_return - low.mean_return) / width


class Reference(JsonObject):
    """All of `reference_returns.json`."""

    version: int
    made_by: str
    scales: list[Scale]


@cache
def reference() -> Reference:
    """The reference returns, read once."""
    return Reference.model_validate_json(FILE.read_bytes())


def scale(dynamics: Any, start: Any, steps: int, discount: float) -> Scale | None:
    """The scale for exactly these dynamics, start, steps and discount; None if there is none."""
    wanted = (dynamics, start, steps, discount)
    found = (s for s in reference().scales if (s.dynamics, s.start, s.steps, s.discount) == wanted)
    return next(found, None)
