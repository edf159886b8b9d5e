"""The mediocre baseline of the Siemens offline data."""

from __future__ import annotations

from typing import Literal

import numpy as np

from ibdata.policies.base import SHIFT, VELOCITY, Decision, Deterministic, Floats, Observed

TARGET = 25.0


class Mediocre(Deterministic):
    """Steers velocity, gain and shift to 25.

        (Δv, Δg, Δh) = clip((25 - v, 25 - g, 25 - h), -1, 1)

    Gain and shift oscillate around the target. Source: `siemens-research/lion`, generate_data.py; see `bad`.
    """

    kind: Literal["mediocre"] = "mediocre"

    def decide(self, observed: Observed) -> Decision:
        return Decision(steered(observed, TARGET), observed.memory)


def steered(observed: Observed, target: float) -> Floats:
    """The changes (n, 3) that would bring velocity, gain and shift to a target, not clipped."""
    return target - observed.observations[:, 0, VELOCITY : SHIFT + 1].astype(np.float64)
