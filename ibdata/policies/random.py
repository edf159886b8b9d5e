"""Uniform random exploration."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt

from ibdata.numerics.compiled import compiled
from ibdata.policies.base import Floats, History, Policy
from ibdata.policies.support import INSIDE, Support, each

LOG_DENSITY = float.fromhex("-0x1.0a2b23f3bab73p+1")  # log(1/8)
LOG_EDGE = float.fromhex(
    "-0x1.1542457337d43p+4"
)  # log(2⁻²⁶ / ½): float32 rounds a share of 2⁻²⁶ of U(-1, 1) to 1, and as much to -1


class Random(Policy):
    """Draws each number of the action uniformly from [-1, 1], the paper's random exploration.

    Source: Hein et al. 2017, section "Experimental Prototypes".
    """

    history_length: ClassVar[int] = 0
    uniforms_per_step: ClassVar[int] = 3
    support: ClassVar[Support | None] = each(INSIDE)

    kind: Literal["random"] = "random"

    def act(self, history: History, u: Floats) -> npt.ArrayLike:
        return 2.0 * u - 1.0

    def log_prob(self, history: History, action: npt.NDArray[np.float32]) -> Floats:
        out = np.empty(len(action))
        _log_prob(action, out)
        return out


@compiled
def _log_prob(action: npt.NDArray[np.float32], out: Floats) -> None:
    for i in range(action.shape[0]):
        edges = 0
        for j in range(3):
            edges += abs(action[i, j]) == 1.0
        out[i] = LOG_DENSITY + LOG_EDGE * edges
