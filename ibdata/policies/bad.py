"""The bad baseline of the Siemens offline data."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from ibdata.policies.base import SHIFT, VELOCITY, Deterministic, Floats, History

TARGET = 100.0


class Bad(Deterministic):
    """Steers velocity, gain and shift to 100.

        (Δv, Δg, Δh) = clip((100 - v, 100 - g, 100 - h), -1, 1)

    The observation is the current one, in raw units. Source: `siemens-research/lion`, generate_data.py, which
    also normalises the observation; with that, this baseline and `mediocre` would always take the action
    (1, 1, 1).
    """

    kind: Literal["bad"] = "bad"

    def act(self, history: History, u: Floats) -> npt.ArrayLike:
        return TARGET - history[:, 0, VELOCITY : SHIFT + 1].astype(np.float64)
