"""Baselines: random and safe exploration, a constant action, and the three of the Siemens offline data."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, Field

from ibdata._numerics.arrays import Bools, Float32s, Floats
from ibdata._numerics.compiled import compiled
from ibdata._numerics.random import standard_normal
from ibdata.policies.base import (
    FATIGUE,
    GAIN,
    SETPOINT,
    SHIFT,
    VELOCITY,
    Decision,
    Deterministic,
    Needs,
    Observed,
    Policy,
)
from ibdata.policies.distributions import LOG_HALF, LOG_MASS_AT_EDGE, Distribution, Uniform


class Random(Policy):
    """Draws each number of the action uniformly from [-1, 1], the paper's random exploration.

    Source: Hein et al. 2017, section "Experimental Prototypes".
    """

    needs: ClassVar[Needs] = Needs(history=0, draws=3)

    kind: Literal["random"] = "random"

    def decide(self, observed: Observed) -> Decision:
        return Decision(Uniform(), observed.memory)


LOW, HIGH = 40.0, 60.0
STEERED_MEAN = 0.5
STEERED_SD = float.fromhex("0x1.279a74590331cp-1")  # 1/√3, the standard deviation of U(-1, 1)
LOG_SD_SQRT_2PI = float.fromhex("0x1.7a80e9b6f7754p-2")
LOG_MASS_TOWARDS = float.fromhex("-0x1.a4d22e1380293p+0")  # log P(z >= 1)
LOG_MASS_AWAY = float.fromhex("-0x1.57396f7dee539p+2")  # log P(z <= -1)


class Safe(Policy):
    """Steers velocity and gain back towards [40, 60] when they are outside; the shift moves at random.

        Δx =  n  if x < 40;   -n  if x > 60;   u  otherwise     for x = v and x = g
        Δh =  u
        n ~ N(1/2, 1/3), clipped to [-1, 1];   u ~ U(-1, 1);   drawn anew for each

    Source: Depeweg et al. 2018 (arXiv 1710.07283), appendix C.3.1, as restated by `angelolovatto/raylab`; we
    take 1/√3 as the standard deviation.
    """

    needs: ClassVar[Needs] = Needs(history=1, draws=5)

    kind: Literal["safe"] = "safe"

    def decide(self, observed: Observed) -> Decision:
        return Decision(Steered(observed.observations), observed.memory)


class Steered(Distribution):
    """The distribution of `Safe`: n in velocity and gain where they are steered, else u.

    Each number of an action has its own choice of two draws; `OrUniform` replaces whole actions.
    """

    draws = 5

    def __init__(self, observations: Float32s) -> None:
        self.observations = observations  # (n, history, 6)

    def sample(self, u: Floats) -> Floats:
        return _steered_actions(self.observations, u)

    def log_density(self, action: Float32s) -> Floats:
        return _log_steered(self.observations, action)

    def atoms(self, action: Float32s) -> Bools:
        """At ±1 in velocity and gain, where they are steered."""
        edges: Bools = np.abs(action) == 1.0
        steered = self.observations[:, 0, VELOCITY : GAIN + 1]
        edges[:, :2] &= (steered < LOW) | (steered > HIGH)
        edges[:, 2] = False
        return edges


@compiled
def _region(x: float) -> float:
    """The sign of n: 1 below [40, 60], -1 above it, 0 inside, where the action is uniform."""
    return 1.0 if x < LOW else -1.0 if x > HIGH else 0.0


@compiled
def _steered_actions(history: Float32s, u: Floats) -> Floats:
    action = np.empty((history.shape[0], 3))
    for i in range(history.shape[0]):
        for j, column in ((0, VELOCITY), (1, GAIN)):
            side = _region(history[i, 0, column])
            if side == 0.0:
                action[i, j] = 2.0 * u[i, 2 + j] - 1.0
            else:
                action[i, j] = side * (STEERED_MEAN + STEERED_SD * standard_normal(u[i, j]))
        action[i, 2] = 2.0 * u[i, 4] - 1.0
    return action


@compiled
def _log_component(x: float) -> float:
    return LOG_MASS_AT_EDGE if abs(x) == 1.0 else LOG_HALF


@compiled
def _log_steered(history: Float32s, action: Float32s) -> Floats:
    out = np.empty(action.shape[0])
    for i in range(history.shape[0]):
        total = _log_component(action[i, 2])
        for j, column in ((0, VELOCITY), (1, GAIN)):
            side = _region(history[i, 0, column])
            z = side * np.float64(action[i, j])
            if side == 0.0:
                total += _log_component(action[i, j])
            elif z >= 1.0:
                total += LOG_MASS_TOWARDS
            elif z <= -1.0:
                total += LOG_MASS_AWAY
            else:
                z = (z - STEERED_MEAN) / STEERED_SD
                total -= 0.5 * z * z + LOG_SD_SQRT_2PI
        out[i] = total
    return out


Component = Annotated[float, Field(ge=-1.0, le=1.0, strict=True), AfterValidator(lambda value: value + 0.0)]


class Constant(Deterministic):
    """Takes the same action (Δv, Δg, Δh) at every step, by default (0, 0, 0), which changes nothing."""

    needs: ClassVar[Needs] = Needs(history=0)

    kind: Literal["constant"] = "constant"
    action: tuple[Component, Component, Component] = Field(
        default=(0.0, 0.0, 0.0), description="(Δv, Δg, Δh), each in [-1, 1]"
    )

    def decide(self, observed: Observed) -> Decision:
        return Decision(np.tile(np.array(self.action), (len(observed.step), 1)), observed.memory)


class Bad(Deterministic):
    """Steers velocity, gain and shift to 100.

        (Δv, Δg, Δh) = clip((100 - v, 100 - g, 100 - h), -1, 1)

    Source: `siemens-research/lion`, generate_data.py, which also normalises the observation; with that, this
    baseline and `mediocre` would always take the action (1, 1, 1).
    """

    kind: Literal["bad"] = "bad"

    def decide(self, observed: Observed) -> Decision:
        return Decision(_towards(observed, 100.0), observed.memory)


class Mediocre(Deterministic):
    """Steers velocity, gain and shift to 25.

        (Δv, Δg, Δh) = clip((25 - v, 25 - g, 25 - h), -1, 1)

    Gain and shift oscillate around the target. Source: `siemens-research/lion`, generate_data.py; see `bad`.
    """

    kind: Literal["mediocre"] = "mediocre"

    def decide(self, observed: Observed) -> Decision:
        return Decision(_towards(observed, 25.0), observed.memory)


def _towards(observed: Observed, target: float) -> Floats:
    """The changes (n, 3) that would bring velocity, gain and shift to a target, not clipped."""
    return target - observed.observations[:, 0, VELOCITY : SHIFT + 1].astype(np.float64)


# Of setpoint, velocity, gain, shift, fatigue, consumption; constants of the policy, not of a dataset.
OBSERVATION_MEAN = (55.0, 48.75, 50.53, 49.45, 37.51, 166.33)
OBSERVATION_STD = (28.72, 12.31, 29.91, 29.22, 31.17, 139.44)


class Optimized(Deterministic):
    """A short formula of past observations, far better than random actions.

        Δv = clip(-z_v(5) - 0.91, -1, 1)
        Δg = clip(2 z_f(3) - z_p + 1.43, -1, 1)
        Δh = clip(-3.48 z_h(3) - z_h(4) + 2 z_p + 0.81, -1, 1)
        z_x(k) = (x of the observation k steps ago - its mean) / its standard deviation;   z_p = z_p(0)

    Means and standard deviations are those of the source: `siemens-research/lion`, generate_data.py.
    """

    needs: ClassVar[Needs] = Needs(history=6)

    kind: Literal["optimized"] = "optimized"

    def decide(self, observed: Observed) -> Decision:
        return Decision(_optimized_actions(observed.observations), observed.memory)


@compiled
def _z(x: float, column: int) -> float:
    """Standardise a value of a column."""
    return (x - OBSERVATION_MEAN[column]) / OBSERVATION_STD[column]


@compiled
def _optimized_actions(history: Float32s) -> Floats:
    action = np.empty((history.shape[0], 3))
    for i in range(history.shape[0]):
        p = _z(np.float64(history[i, 0, SETPOINT]), SETPOINT)
        v5 = _z(np.float64(history[i, 5, VELOCITY]), VELOCITY)
        f3 = _z(np.float64(history[i, 3, FATIGUE]), FATIGUE)
        h3 = _z(np.float64(history[i, 3, SHIFT]), SHIFT)
        h4 = _z(np.float64(history[i, 4, SHIFT]), SHIFT)
        action[i, 0] = -v5 - 0.91
        action[i, 1] = 2.0 * f3 - p + 1.43
        action[i, 2] = -3.48 * h3 - h4 + 2.0 * p + 0.81
    return action
