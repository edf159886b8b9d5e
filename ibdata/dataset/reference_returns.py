"""Returns of known policies, measured once, and the scale from random actions (0) to optimized ones (100).

scripts/reference-returns makes `reference_returns.json`. Reading it needs neither the simulator nor a policy.
"""

from __future__ import annotations

import json
import math
from functools import cache
from pathlib import Path
from typing import Any

FILE = Path(__file__).with_name("reference_returns.json")
ZERO, HUNDRED = "random", "optimized"
SIGMAS = 5.0


class Scale:
    """The returns of the reference policies under one dynamics, start, number of steps and discount."""

    def __init__(self, data: dict[str, Any]) -> None:
        self.data = data

    @property
    def text(self) -> str:
        """What the scale is, for those who read a score."""
        return (
            f"0 = {ZERO}, 100 = {HUNDRED} at the same setpoint: {self.data['dynamics']} dynamics, default "
            f"start, {self.data['steps']} steps, discount {self.data['discount']:g}"
        )

    def score(self, setpoint: float, mean_return: float) -> float | None:
        """A mean return on the scale; None where the scale has no such setpoint, or its ends are too near.

        The upper end must be above the lower one by five standard errors of the difference.
        """
        low, high = self._of(ZERO, setpoint), self._of(HUNDRED, setpoint)
        if low is None or high is None:
            return None
        width = high["mean_return"] - low["mean_return"]
        if width <= SIGMAS * math.hypot(low["standard_error"], high["standard_error"]):
            return None
        return float(100.0 * (mean_return - low["mean_return"]) / width)

    def _of(self, policy: str, setpoint: float) -> dict[str, Any] | None:
        rows = self.data["results"]
        return next((r for r in rows if r["policy"] == policy and r["setpoint"] == setpoint), None)


@cache
def reference() -> dict[str, Any]:
    """All of `reference_returns.json`."""
    data: dict[str, Any] = json.loads(FILE.read_text(encoding="utf-8"))
    return data


def scale(dynamics: Any, start: Any, steps: int, discount: float) -> Scale | None:
    """The scale for these, or None: only equal things are compared."""
    wanted = (dynamics, start, steps, discount)
    for data in reference()["scales"]:
        if (data["dynamics"], data["start"], data["steps"], data["discount"]) == wanted:
            return Scale(data)
    return None
