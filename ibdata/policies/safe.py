"""The safe baseline with limited randomness."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from ibdata.numerics.compiled import compiled
from ibdata.numerics.random import standard_normal
from ibdata.policies.base import GAIN, VELOCITY, Decision, Needs, Observed, Policy
from ibdata.policies.distributions import LOG_HALF, LOG_MASS_AT_EDGE, Bools, Distribution, Float32s, Floats

LOW, HIGH = 40.0, 60.0
MEAN = 0.5
SD = float.fromhex("0x1.279a74590331cp-1")  # 1/√3, the standard deviation of U(-1, 1)
LOG_SD_SQRT_2PI = float.fromhex("0x1.7a80e9b6f7754p-2")
LOG_MASS_TOWARDS = float.fromhex("-0x1.a4d22e1380293p+0")  # log P(z >= 1)
LOG_MASS_AWAY = float.fromhex("-0x1.57396f7dee539p+2")  # log P(z <= -1)


class Safe(Policy):
    """Steers velocity and gain back towards [40, 60] when they are outside; the shift moves at random.

        Δx =  z  if x < 40;   -z  if x > 60;   u  otherwise     for x = v and x = g
        Δh =  u

    z ~ N(½, 1/3), clipped to [-1, 1], and u ~ U(-1, 1). Source: Depeweg et al. 2018 (arXiv 1710.07283),
    appendix C.3.1, as restated by `angelolovatto/raylab`; we take 1/√3 as the standard deviation.
    """

    needs: ClassVar[Needs] = Needs(history=1, step_draws=5)

    kind: Literal["safe"] = "safe"

    def decide(self, observed: Observed) -> Decision:
        return Decision(Steered(observed.observations), observed.memory)


class Steered(Distribution):
    """The distribution of `Safe`: z in velocity and gain where they are steered, else u.

    A number of an action takes one of two draws of its own, so that it is no `Mixture`.
    """

    draws = 5

    def __init__(self, observations: Float32s) -> None:
        self.observations = observations  # (n, history, 6)

    def sample(self, u: Floats) -> Floats:
        return _actions(self.observations, u)

    def log_density(self, action: Float32s) -> Floats:
        return _log_density(self.observations, action)

    def atoms(self, action: Float32s) -> Bools:
        """At ±1 in velocity and gain, where they are steered."""
        edges: Bools = np.abs(action) == 1.0
        steered = self.observations[:, 0, VELOCITY : GAIN + 1]
        edges[:, :2] &= (steered < LOW) | (steered > HIGH)
        edges[:, 2] = False
        return edges


@compiled
def _region(x: float) -> float:
    """The sign of z: 1 below [40, 60], -1 above it, 0 inside, where the action is uniform."""
    return 1.0 if x < LOW else -1.0 if x > HIGH else 0.0


@compiled
def _actions(history: Float32s, u: Floats) -> Floats:
    action = np.empty((history.shape[0], 3))
    for i in range(history.shape[0]):
        for j, column in ((0, VELOCITY), (1, GAIN)):
            side = _region(history[i, 0, column])
            if side == 0.0:
                action[i, j] = 2.0 * u[i, 2 + j] - 1.0
            else:
                action[i, j] = side * (MEAN + SD * standard_normal(u[i, j]))
        action[i, 2] = 2.0 * u[i, 4] - 1.0
    return action


@compiled
def _log_uniform(x: float) -> float:
    return LOG_MASS_AT_EDGE if abs(x) == 1.0 else LOG_HALF


@compiled
def _log_density(history: Float32s, action: Float32s) -> Floats:
    out = np.empty(action.shape[0])
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
    return out
