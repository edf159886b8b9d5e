"""The best policy that is known in closed form."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from ibdata.dynamics.miscalibration import PHI_MAX, RHO_S, SAFE_ZONE, effective_shift, sgn, update_direction
from ibdata.dynamics.steering import D_G, D_H, D_V
from ibdata.numerics.compiled import compiled
from ibdata.policies.base import GAIN, SETPOINT, SHIFT, VELOCITY, Deterministic, Floats, History
from ibdata.policies.given import Decision, Given

Table = tuple[tuple[float, float, float], ...]

# (setpoint, velocity, gain), found by scripts/expert. Between two rows the values are interpolated; at a
# setpoint with two rows, high gains end and low gains begin.
SIEMENS: Table = (
    (0.0, 40.0, 100.0),
    (20.0, 40.0, 100.0),
    (25.0, 39.0, 100.0),
    (30.0, 38.0, 100.0),
    (35.0, 36.0, 100.0),
    (40.0, 34.5, 96.5),
    (45.0, 32.0, 92.0),
    (52.0, 30.5, 91.0),
    (52.0, 41.0, 53.0),
    (55.0, 41.0, 50.0),
    (60.0, 40.5, 48.0),
    (65.0, 39.5, 46.5),
    (70.0, 38.5, 45.5),
    (75.0, 37.5, 44.5),
    (80.0, 36.5, 43.5),
    (85.0, 35.0, 43.0),
    (90.0, 34.0, 42.5),
    (95.0, 33.0, 41.0),
    (100.0, 32.0, 40.0),
)
PAPER: Table = (
    (0.0, 40.0, 100.0),
    (30.0, 40.0, 100.0),
    (83.5, 27.0, 100.0),
    (83.5, 62.0, 0.0),
    (100.0, 57.0, 0.0),
)
TABLES = {"siemens": SIEMENS, "paper": PAPER}
TURNING = 0.125  # effective shift at which the direction turns to 0, inside the safe zone
UNKNOWN = PHI_MAX  # steps in the safe zone after which the direction is 0, whatever it was


class Expert(Deterministic):
    """Constant velocity and gain per setpoint, and the optimal shift, which oscillates.

    Hein et al. 2017 show in their figure 3a that the optimal effective shift follows the direction φ on a
    sine, hᵉ = sin(πφ/12). The policy cannot see φ, but computes it: it remembers domain, response and
    direction, and applies Eqs. (9) to (16) to the shifts that it sees. From φ = 0 it goes to 6 or to -6,
    whichever is on the side of the shift, and back, and then passes through the safe zone. If an episode
    begins after a burn-in, φ is unknown, and the policy first stays in the safe zone until φ must be 0.

    At the first observation it takes φ to be 0, although the step with action zero has moved φ to 1 or -1
    where the shift is outside the safe zone: at the default start, for setpoints below 43.5 or above 56.5. So
    its first turn of 12 steps is a step late, which costs 14 to 31 of the return at setpoints 10, 70 and 100.
    This stays as it is, so that the data of `expert` keep their content.

    Velocity and gain are the constants that cost least over 1000 steps from the default start.
    `scripts/expert` finds them at every fifth setpoint; high gains end and low gains begin between two of
    these.
    """

    history_length: ClassVar[int] = 2
    memory_size: ClassVar[int] = 4  # domain, response, direction, steps until the direction is known

    kind: Literal["expert"] = "expert"
    dynamics: Literal["siemens", "paper"] = Field(
        default="siemens", description="the dynamics for which velocity and gain are the best"
    )

    def decide(self, given: Given) -> Decision:
        actions = np.empty((len(given.step), 3))
        memory = np.empty((len(given.step), 4))
        _decide(
            given.observations, given.step, given.memory, np.array(TABLES[self.dynamics]), actions, memory
        )
        return Decision(actions, memory)


@compiled
def interpolated(table: Floats, p: float, column: int) -> float:
    """A column of the table at setpoint p in [0, 100]."""
    i = 0
    while i < table.shape[0] - 2 and table[i + 1, 0] <= p:
        i += 1
    share = (p - table[i, 0]) / (table[i + 1, 0] - table[i, 0])
    return float(table[i, column] + share * (table[i + 1, column] - table[i, column]))


@compiled
def best_shift(he: float, domain: int, response: int, direction: int) -> float:
    """The effective shift to aim at, from the present one and the domain, response and direction.

    >>> best_shift(0.3, 1, 1, 0) == best_shift(0.9, 1, -1, 2) == RHO_S[1]
    True
    """
    side = sgn(direction) if direction != 0 else (1 if he >= 0.0 else -1)
    if direction != 0 and domain != side:
        return side * TURNING
    away = response > 0 or direction == 0
    following = min(abs(direction) + 1, PHI_MAX) if away else abs(direction) - 1
    return side * RHO_S[following] if following > 0 else side * TURNING


@compiled
def _decide(
    history: History, step: npt.NDArray[np.int64], memory: Floats, table: Floats, actions: Floats, new: Floats
) -> None:
    for i in range(history.shape[0]):
        p = np.float64(history[i, 0, SETPOINT])
        v, g = np.float64(history[i, 0, VELOCITY]), np.float64(history[i, 0, GAIN])
        h = np.float64(history[i, 0, SHIFT])
        he = effective_shift(h, p)
        domain, response, direction, unknown = 1, 1, 0, 0
        if step[i] > 0:
            domain, response = int(memory[i, 0]), int(memory[i, 1])
            domain, response, direction = update_direction(domain, response, int(memory[i, 2]), he)
            unknown = int(memory[i, 3]) - 1 if abs(he) <= SAFE_ZONE else UNKNOWN
            unknown = max(0, unknown) if memory[i, 3] > 0.0 else 0
        else:
            for column in range(history.shape[2]):
                if history[i, 0, column] != history[i, 1, column]:
                    unknown = UNKNOWN
        if unknown > 0:
            domain, response, direction = 1, 1, 0
            aim = TURNING if he >= 0.0 else -TURNING
        else:
            aim = best_shift(he, domain, response, direction)
        actions[i, 0] = (interpolated(table, p, 1) - v) / D_V
        actions[i, 1] = (interpolated(table, p, 2) - g) / D_G
        actions[i, 2] = (20.0 * (aim + p / 50.0 + 1.5) - h) / D_H
        new[i, 0], new[i, 1], new[i, 2], new[i, 3] = domain, response, direction, unknown
