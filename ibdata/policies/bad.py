"""The bad baseline of the Siemens offline data."""

from __future__ import annotations

from typing import Literal

from ibdata.policies.base import Decision, Deterministic, Observed
from ibdata.policies.mediocre import steered

TARGET = 100.0


class Bad(Deterministic):
    """Steers velocity, gain and shift to 100.

        (Δv, Δg, Δh) = clip((100 - v, 100 - g, 100 - h), -1, 1)

    Source: `siemens-research/lion`, generate_data.py, which also normalises the observation; with that, this
    baseline and `mediocre` would always take the action (1, 1, 1).
    """

    kind: Literal["bad"] = "bad"

    def decide(self, observed: Observed) -> Decision:
        return Decision(steered(observed, TARGET), observed.memory)
