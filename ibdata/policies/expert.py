"""The expert: a table of velocities and gains and a few rules, on what it sees."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from ibdata._numerics.arrays import Float32s, Floats
from ibdata._numerics.compiled import compiled
from ibdata._numerics.exact import clip
from ibdata.dynamics.fatigue import (
    TOLERANCE,
    basic_fatigue,
    effective_gain,
    effective_velocity,
    velocity_transform,
)
from ibdata.dynamics.miscalibration import PHI_MAX, RHO_S, SAFE_ZONE, effective_shift, sgn, update_direction
from ibdata.dynamics.setpoint import D_G, D_H, D_V
from ibdata.dynamics.variants import VARIANTS, Parameters
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
    Steps,
)
from ibdata.views.variables import AMPLIFICATION_START

FILE = Path(__file__).with_name("expert.json")  # made by studies/expert
# Columns of a table: the setpoint, the velocity to aim at, and the best gains at velocities 0, 5 … 100.
AIM, GAINS, SPACING = 1, 2, 5.0
TURNING = 0.1294  # effective shift at which the direction turns to 0, just inside the safe zone
UNKNOWN = PHI_MAX  # steps in the safe zone after which the direction is 0, whatever it was
VISIBLE = 1.0  # basic fatigue from which fatigue shows α
ALARM = 2  # observations in a row with the α of a runaway, from which there is one
LEAVING = 3  # the state of alarm while the velocity's runaway is left
BEYOND = 0.5  # how far the velocity goes beyond the one that resets its μ


class Feedback(NamedTuple):
    """How velocity and gain depend on the estimate of μᵛ and on α."""

    rise: float  # of the velocity, for each unit of μᵛ above the next number
    rise_from: float
    fall: float  # of the gain from 100, for each unit of μᵛ above the next number
    fall_from: float
    runaway: float  # α above which a runaway is assumed; 1 for never


class Expert(Deterministic):
    """Takes velocity and gain from a table, corrects them by the fatigue, and moves the shift optimally.

    The optimal effective shift is hᵉ = sin(πφ/12), by figure 3a of Hein et al. 2017. The policy cannot see
    the direction φ, but computes it from the shifts that it sees, by Eqs. (9) to (16); after a burn-in it
    waits in the safe zone until φ must be 0. A table gives the velocity and the gain of a setpoint. In
    `siemens`, the velocity rises and the gain falls as its estimate of μᵛ grows. After two observations with
    α > 0.75 there is a runaway: the gain goes up until its own μ is reset; if α stays high, the velocity
    goes to where gain 0 resets μᵛ. `studies/expert` finds the numbers.
    """

    # It remembers domain, response, direction, the steps until these are known, μᵛ, and the state of alarm.
    needs: ClassVar[Needs] = Needs(history=2, memory=6)

    kind: Literal["expert"] = "expert"
    dynamics: Literal["siemens", "paper"] = Field(
        default="siemens", description="the dynamics for which the policy is made"
    )

    def decide(self, observed: Observed) -> Decision:
        n = len(observed.step)
        actions, memory = np.empty((n, 3)), np.empty((n, 6))
        table, rule = numbers(self.dynamics)
        k = VARIANTS[self.dynamics].parameters
        _decide(observed.observations, observed.step, observed.memory, table, rule, k, actions, memory)
        return Decision(actions, memory)


@cache
def numbers(dynamics: str) -> tuple[Floats, Feedback]:
    """The table (rows, 23) and the feedback of a variant.

    Between two rows the values are interpolated. At a setpoint with two rows one way to run the system ends
    and another begins.
    """
    stored = json.loads(FILE.read_text(encoding="utf-8"))[dynamics]
    return np.array(stored["table"]), Feedback(**stored["feedback"])


@compiled
def interpolated(table: Floats, p: float, column: int) -> float:
    """A column of the table at setpoint p in [0, 100]."""
    i = 0
    while i < table.shape[0] - 2 and table[i + 1, 0] <= p:
        i += 1
    share = (p - table[i, 0]) / (table[i + 1, 0] - table[i, 0])
    return float(table[i, column] + share * (table[i + 1, column] - table[i, column]))


@compiled
def best_gain(table: Floats, p: float, v: float) -> float:
    """The gain of the table at setpoint p and velocity v."""
    i = min(int(v / SPACING), table.shape[1] - GAINS - 2)
    low, high = interpolated(table, p, GAINS + i), interpolated(table, p, GAINS + i + 1)
    return float(low + (v / SPACING - i) * (high - low))


@compiled
def resetting_velocity(p: float, k: Parameters) -> float:
    """The velocity at which vᵉ is 0.05 with gain 0."""
    (v0, g0), (v1, g1) = k.effective_velocity_ends
    t0, t1 = velocity_transform(v0, g0, p), velocity_transform(v1, g1, p)
    return (p + 2.0) / (t0 + TOLERANCE * (t1 - t0)) + p - 101.0


@compiled
def next_alarm(alarm: int, visible: bool, high: bool) -> int:
    """The next state of alarm, from whether fatigue shows α and whether it is that of a runaway.

    >>> next_alarm(0, True, True), next_alarm(ALARM, False, False), next_alarm(LEAVING, False, False)
    (1, 0, 3)
    """
    if alarm == LEAVING:
        return LEAVING if high or not visible else 0
    return min(alarm + 1, ALARM) if high else 0


@compiled
def velocity_and_gain(
    p: float, v: float, g: float, f: float, mu: float, alarm: int,
    table: Floats, rule: Feedback, k: Parameters,
) -> tuple[float, float, float, int]:  # fmt: skip
    """The velocity and the gain to aim at, the next estimate of μᵛ, and the next state of alarm.

    p, v, g and f are the present setpoint, velocity, gain and fatigue.
    """
    aim, gain = interpolated(table, p, AIM), best_gain(table, p, v)
    if basic_fatigue(aim, best_gain(table, p, aim)) <= VISIBLE:
        return aim, gain, 0.0, 0
    f_b = basic_fatigue(v, g)
    ve, ge = effective_velocity(v, g, p, k.effective_velocity_ends), effective_gain(g, p)
    visible = f_b > VISIBLE
    alpha = clip((3.0 * f / f_b - 1.0) / 2.0, 0.0, 1.0) if visible else 0.0
    eta = alpha if ve >= ge else 0.0  # α is the larger of the two η
    mu = ve if ve <= TOLERANCE else min(AMPLIFICATION_START, 0.9 * mu + eta / 3.0)
    alarm = next_alarm(alarm, visible, alpha > rule.runaway)
    if alarm == ALARM and ge <= TOLERANCE:
        alarm = LEAVING
    if alarm == LEAVING and ve <= TOLERANCE:
        alarm = 0

    if alarm == LEAVING:
        reset = resetting_velocity(p, k)
        return reset + BEYOND, 0.0 if (reset - v) / D_V <= g / D_G else gain, mu, alarm
    aim += rule.rise * max(0.0, mu - rule.rise_from)
    gain = min(gain, 100.0 - rule.fall * max(0.0, mu - rule.fall_from))
    return aim, 100.0 if alarm == ALARM else gain, mu, alarm


@compiled
def best_shift(he: float, domain: int, response: int, direction: int) -> float:
    """The effective shift to aim at, from the present one and the domain, response and direction.

    >>> best_shift(0.3, 1, 1, 0) == best_shift(0.9, 1, -1, 2) == RHO_S[1]
    True
    """
    side = sgn(direction) if direction != 0 else (1 if he >= 0.0 else -1)
    away = direction == 0 or (response > 0 and domain == side)
    following = min(abs(direction) + 1, PHI_MAX) if away else abs(direction) - 1
    return side * RHO_S[following] if following > 0 else side * TURNING


@compiled
def _decide(
    history: Float32s, step: Steps, memory: Floats, table: Floats, rule: Feedback, k: Parameters,
    actions: Floats, new: Floats,
) -> None:  # fmt: skip
    for i in range(history.shape[0]):
        p = np.float64(history[i, 0, SETPOINT])
        v, g = np.float64(history[i, 0, VELOCITY]), np.float64(history[i, 0, GAIN])
        h, f = np.float64(history[i, 0, SHIFT]), np.float64(history[i, 0, FATIGUE])
        he = effective_shift(h, p)
        domain, response, direction, unknown, mu, alarm = 1, 1, 0, 0, 0.0, 0
        if step[i] > 0:
            domain, response, direction = int(memory[i, 0]), int(memory[i, 1]), int(memory[i, 2])
            unknown, mu, alarm = int(memory[i, 3]), memory[i, 4], int(memory[i, 5])
            if unknown > 0:
                unknown = unknown - 1 if abs(he) <= SAFE_ZONE else UNKNOWN
        else:
            for column in range(history.shape[2]):
                if history[i, 0, column] != history[i, 1, column]:
                    unknown = UNKNOWN
        if unknown > 0:
            domain, response, direction = 1, 1, 0
            aim = TURNING if he >= 0.0 else -TURNING
        else:
            domain, response, direction = update_direction(domain, response, direction, he)
            aim = best_shift(he, domain, response, direction)
        velocity, gain, mu, alarm = velocity_and_gain(p, v, g, f, mu, alarm, table, rule, k)
        actions[i, 0] = (velocity - v) / D_V
        actions[i, 1] = (gain - g) / D_G
        actions[i, 2] = (20.0 * (aim + p / 50.0 + 1.5) - h) / D_H
        new[i, 0], new[i, 1], new[i, 2] = domain, response, direction
        new[i, 3], new[i, 4], new[i, 5] = unknown, mu, alarm
