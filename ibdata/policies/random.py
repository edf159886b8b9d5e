"""Uniform random exploration."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt

from ibdata.policies.base import Floats, History, Policy

LOG_DENSITY = float.fromhex("-0x1.0a2b23f3bab73p+1")  # log(1/8)


class Random(Policy):
    """Each of the three actions uniform on [-1, 1]: the paper's random exploration.

    Hein et al. 2017, section "Experimental Prototypes", random exploration.
    """

    draws: ClassVar[int] = 3

    kind: Literal["random"] = "random"

    def act(self, history: History, u: Floats) -> npt.ArrayLike:
        return 2.0 * u - 1.0

    def log_prob(self, history: History, action: npt.NDArray[np.float32]) -> Floats:
        return np.full(len(action), LOG_DENSITY)
