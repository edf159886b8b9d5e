"""The mediocre baseline of the Siemens offline data."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from ibdata.policies.base import SHIFT, VELOCITY, Deterministic, Floats, History

TARGET = 25.0


class Mediocre(Deterministic):
    """Steers velocity, gain and shift to 25.

        (Δv, Δg, Δh) = clip((25 - v, 25 - g, 25 - h), -1, 1)

    The observation is the current one, in raw units, so gain and shift oscillate around the target. Source:
    `siemens-research/lion`, generate_data.py; see `bad` for the units.
    """

    kind: Literal["mediocre"] = "mediocre"

    def act(self, history: History, u: Floats) -> npt.ArrayLike:
        return TARGET - history[:, 0, VELOCITY : SHIFT + 1].astype(np.float64)
