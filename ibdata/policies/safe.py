"""The safe baseline with limited randomness."""

from __future__ import annotations

from itertools import product
from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt

from ibdata.numerics.compiled import compiled
from ibdata.numerics.random import standard_normal
from ibdata.policies.base import GAIN, VELOCITY, Floats, History, Policy
from ibdata.policies.support import INSIDE, SOME_EDGES, Support

STEERED = (INSIDE, SOME_EDGES._replace(of="safe"))  # of velocity and gain
LOW, HIGH = 40.0, 60.0
MEAN = 0.5
SD = float.fromhex("0x1.279a74590331cp-1")  # 1/√3, the standard deviation of U(-1, 1)
LOG_SD_SQRT_2PI = float.fromhex("0x1.7a80e9b6f7754p-2")
LOG_MASS_TOWARDS = float.fromhex("-0x1.a4d22e1380293p+0")  # log P(z >= 1)
LOG_MASS_AWAY = float.fromhex("-0x1.57396f7dee539p+2")  # log P(z <= -1)
LOG_UNIFORM = float.fromhex("-0x1.62e42fefa39efp-1")  # log ½
LOG_EDGE = float.fromhex(
    "-0x1.205966f2b4f12p+4"
)  # log 2⁻²⁶, the share of U(-1, 1) that float32 rounds to 1, and to -1


class Safe(Policy):
    """Steers velocity and gain back towards [40, 60] when they are outside; the shift moves at random.

        Δx =  z  if x < 40;   -z  if x > 60;   u  otherwise     for x = v and x = g
        Δh =  u

    z ~ N(½, 1/3), clipped to [-1, 1], and u ~ U(-1, 1). Source: Depeweg et al. 2018 (arXiv 1710.07283),
    appendix C.3.1, as restated by `angelolovatto/raylab`; we take 1/√3 as the standard deviation.
    """

    uniforms_per_step: ClassVar[int] = 5
    support: ClassVar[Support | None] = frozenset(product(STEERED, STEERED, (INSIDE,)))

    kind: Literal["safe"] = "safe"

    def act(self, history: History, u: Floats) -> npt.ArrayLike:
        action = np.empty((len(history), 3))
        _act(history, u, action)
        return action

    def log_prob(self, history: History, action: npt.NDArray[np.float32]) -> Floats:
        out = np.empty(len(action))
        _log_prob(history, action, out)
        return out


@compiled
def _region(x: float) -> float:
    """The sign of z: 1 below [40, 60], -1 above it, 0 inside, where the action is uniform."""
    return 1.0 if x < LOW else -1.0 if x > HIGH else 0.0


@compiled
def _act(history: History, u: Floats, action: Floats) -> None:
    for i in range(history.shape[0]):
        for j, column in ((0, VELOCITY), (1, GAIN)):
            side = _region(history[i, 0, column])
            if side == 0.0:
                action[i, j] = 2.0 * u[i, 2 + j] - 1.0
            else:
                action[i, j] = side * (MEAN + SD * standard_normal(u[i, j]))
        action[i, 2] = 2.0 * u[i, 4] - 1.0


@compiled
def _log_uniform(x: float) -> float:
    return LOG_EDGE if abs(x) == 1.0 else LOG_UNIFORM


@compiled
def _log_prob(history: History, action: npt.NDArray[np.float32], out: Floats) -> None:
    for i in range(history.shape[0]):
        total = _log_uniform(action[i, 2])
        for j, column in ((0, VELOCITY), (1, GAIN)):
            side = _region(history[i, 0, column])
            z = side * np.float64(action[i, j])
            if side == 0.0:
                total += _log_uniform(action[i, j])
            elif z >= 1.0:
                total += LOG_MASS_TOWARDS
            elif z <= -1.0:
                total += LOG_MASS_AWAY
            else:
                total -= 0.5 * ((z - MEAN) / SD) * ((z - MEAN) / SD) + LOG_SD_SQRT_2PI
        out[i] = total
