"""The optimized baseline of the Siemens offline data."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from ibdata.numerics.compiled import compiled
from ibdata.policies.base import (
    FATIGUE,
    SETPOINT,
    SHIFT,
    VELOCITY,
    Decision,
    Deterministic,
    Float32s,
    Floats,
    Needs,
    Observed,
)

# Of setpoint, velocity, gain, shift, fatigue, consumption; constants of the policy, not of a dataset.
MEAN = (55.0, 48.75, 50.53, 49.45, 37.51, 166.33)
STD = (28.72, 12.31, 29.91, 29.22, 31.17, 139.44)


class Optimized(Deterministic):
    """A short formula of past observations, far better than random actions.

        Δv = clip(-z_v(5) - 0.91, -1, 1)
        Δg = clip(2 z_f(3) - z_p + 1.43, -1, 1)
        Δh = clip(-3.48 z_h(3) - z_h(4) + 2 z_p + 0.81, -1, 1)

    z_x(k) is column x of the observation k steps ago, standardised by the means and standard deviations in
    the source: `siemens-research/lion`, generate_data.py.
    """

    needs: ClassVar[Needs] = Needs(history=6)

    kind: Literal["optimized"] = "optimized"

    def decide(self, observed: Observed) -> Decision:
        return Decision(_actions(observed.observations), observed.memory)


@compiled
def _z(x: float, column: int) -> float:
    """Standardise a value of a column."""
    return (x - MEAN[column]) / STD[column]


@compiled
def _actions(history: Float32s) -> Floats:
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
