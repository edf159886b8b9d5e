"""Each equation against values by hand, its range, and the direction in which it moves.

The equations together, in the order of a step, are compared with the published package and with a second
implementation of the printed ones in `tests/reference`.
"""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from helpers.examples import tries
from hypothesis import given
from hypothesis import strategies as st

from ibdata.dynamics import PAPER, SIEMENS
from ibdata.dynamics.consumption import consumption, expected_consumption, reward
from ibdata.dynamics.fatigue import (
    amplification,
    basic_fatigue,
    bernoulli,
    effective_gain,
    effective_velocity,
    fatigue,
    gain_transform,
    mixed_noise,
    noise_component,
    squashed_exponential,
    update_mu,
    velocity_transform,
)
from ibdata.dynamics.miscalibration import effective_shift, penalty, radius
from ibdata.dynamics.operational_cost import convolved_cost, operational_cost, remember
from ibdata.dynamics.setpoint import moved
from ibdata.dynamics.steering import D_G, D_H, D_V, clip, steer

SIEMENS_ENDS, PAPER_ENDS = (100.0, 0.0, 0.0, 100.0), (0.0, 100.0, 100.0, 0.0)
TANH = math.tanh(0.1)  # 2 (σ(0.1 e) - ½) at e = 2
SQUASHED = 1.0 / (1.0 + math.exp(-0.1))  # σ(0.05 e) at e = 2
BIFURCATED = 1.0 / (1.0 + math.exp(-2.8))  # σ(2.4 + 0.4 z) at z = 1
VALUES = [
    (expected_consumption, (70.0, -0.5, 0.0), 57.5),  # 70 - 12.5
    (expected_consumption, (70.0, -0.5, 1.0), 82.5),
    (expected_consumption, (70.0, -1.0, 1.0), 70.0),  # the best penalty cancels the offset
    (consumption, (100.0, 1.0, 0.02), 103.0),  # standard deviation 1 + 2
    (consumption, (100.0, -2.0, 0.005), 97.0),
    (consumption, (0.0, 1.0, 0.02), 1.0),
    (reward, (100.0, 20.0), -160.0),  # -100 - 3 · 20
    (velocity_transform, (50.0, 50.0, 50.0), 102.0 / 101.0),  # (50 + 50 + 2) / (50 - 50 + 101)
    (velocity_transform, (0.0, 100.0, 100.0), 202.0),
    (gain_transform, (49.0, 50.0), 0.01),  # 1 / (49 + 50 + 1)
    # (102/101 - 52/151) / (152/51 - 52/151) = (10150/101) / (20300/51) = 51/202, and 1 - 51/202 as printed.
    (effective_velocity, (50.0, 50.0, 50.0, *SIEMENS_ENDS), 51 / 202),
    (effective_velocity, (50.0, 50.0, 50.0, *PAPER_ENDS), 151 / 202),
    (effective_velocity, (100.0, 0.0, 30.0, *SIEMENS_ENDS), 0.0),
    (effective_velocity, (0.0, 100.0, 30.0, *SIEMENS_ENDS), 1.0),
    (effective_gain, (50.0, 0.0), 1 / 102),  # (1/51 - 1/101) / (1 - 1/101)
    (effective_gain, (0.0, 30.0), 1.0),
    (effective_gain, (100.0, 30.0), 0.0),
    (bernoulli, (0.29, 0.3, 0.0, 1.0), 1.0),
    (bernoulli, (0.30, 0.3, 0.0, 1.0), 0.0),  # u < p, strictly
    (bernoulli, (0.0005, 0.0, 0.001, 0.999), 1.0),  # the clipped probability is 0.001
    (bernoulli, (0.0005, 0.0, 0.0, 1.0), 0.0),
    (bernoulli, (0.9995, 1.0, 0.001, 0.999), 0.0),
    (bernoulli, (0.9995, 1.0, 0.0, 1.0), 1.0),
    (squashed_exponential, (2.0, 0.1, 2.0, 0.5), TANH),
    (squashed_exponential, (2.0, 0.05, 1.0, 0.0), SQUASHED),
    (mixed_noise, (0.5, 0.5, 1.0, 0.8), 0.7),  # 0.5 + 0.5 · 0.5 · 0.8
    (mixed_noise, (0.2, 0.9, 0.0, 0.8), 0.2),
    (noise_component, (2.0, 0.5, 0.1, 0.8, SIEMENS.parameters), TANH + (1.0 - TANH) * 0.4),
    (noise_component, (2.0, 0.5, 0.1, 0.8, PAPER.parameters), SQUASHED + (1.0 - SQUASHED) * 0.4),
    (noise_component, (2.0, 0.5, 0.9, 0.8, PAPER.parameters), SQUASHED),
    (update_mu, (3.0, 0.05, 0.9), 0.05),  # reset at 0.05 and below, whatever μ was
    (update_mu, (0.3, 0.0, 0.9), 0.0),
    (update_mu, (3.0, 0.0500001, 0.9), 3.3),  # above 0.05 it runs away: 1.1 · 3
    (update_mu, (1.2, 0.5, 0.9), 1.32),  # from 1.2 on
    (update_mu, (4.8, 0.5, 0.9), 5.0),  # 5.28 is capped
    (update_mu, (1.1999, 0.5, 0.3), 1.17991),  # 0.9 · 1.1999 + 0.1
    (amplification, (1.1, 1.19, 0.2, 0.3, 1.0, 1.2), 0.3),  # max(0.2, 0.3)
    (amplification, (1.2, 0.0, 0.2, 0.3, 1.0, 1.2), BIFURCATED),  # the threshold itself counts
    (amplification, (0.0, 1.2, 0.2, 0.3, 1.0, 1.2), BIFURCATED),
    (amplification, (4.99, 4.99, 0.2, 0.3, 1.0, 5.0), 0.3),
    (amplification, (4.99, 5.0, 0.2, 0.3, 1.0, 5.0), BIFURCATED),
    (basic_fatigue, (0.0, 0.0), 300.0),  # 30000 / 100
    (basic_fatigue, (50.0, 50.0), 425.0 / 7.0),  # 30000/350 - 25
    (basic_fatigue, (100.0, 50.0), 25.0),
    (basic_fatigue, (100.0, 100.0), 0.0),  # 50 - 100 is below zero
    (fatigue, (300.0, 0.0), 100.0),  # f_b (1 + 2 α) / 3
    (fatigue, (60.0, 0.5), 40.0),
    (operational_cost, (50.0, 50.0, 50.0), math.exp(4.25)),  # (100 + 200 + 125) / 100
    (operational_cost, (100.0, 0.0, 0.0), math.exp(2.0)),  # each coefficient alone
    (operational_cost, (0.0, 100.0, 0.0), math.exp(4.0)),
    (operational_cost, (0.0, 0.0, 100.0), math.exp(2.5)),
    (effective_shift, (50.0, 50.0), 0.0),  # 2.5 - 1 - 1.5
    (effective_shift, (60.0, 50.0), 0.5),
    (effective_shift, (50.0, 75.0), -0.5),
    (effective_shift, (70.0, 0.0), 1.5),  # 2 is clipped
    (effective_shift, (0.0, 100.0), -1.5),
    (steer, (50.0, D_V, -0.25), 49.75),
    (steer, (100.0, D_V, 1.0), 100.0),  # held at the bound
    (steer, (50.0, D_G, 0.5), 55.0),
    (steer, (3.0, D_G, -1.0), 0.0),  # -7 is clipped
    (steer, (50.0, D_H, 1.0), 50.0 + 20.0 * 0.258819045102521 / 0.9),
    (steer, (50.0, D_G, -1e300), 40.0),  # an action beyond 1 acts as 1
    (clip, (-2.0, -1.0, 4.0), -1.0),
    (clip, (4.5, -1.0, 4.0), 4.0),
    (moved, (50.0, -0.75), 49.25),
    (moved, (99.5, 0.75), 100.0),
    (moved, (0.25, -0.75), 0.0),
]
UNIT, PERCENT, COST, MU, EXPONENTIAL = (0.0, 1.0), (0.0, 100.0), (-25.0, 5000.0), (0.0, 5.0), (0.0, 36.8)
# Ranges of the arguments, the signs with which the value moves with each (0: both ways), and its range.
LAWS = [
    (operational_cost, (PERCENT,) * 3, (1, 1, 1), (1.0, 4914.77)),
    (velocity_transform, (PERCENT,) * 3, (-1, 1, 1), (2.0 / 201.0, 202.0)),
    (lambda v, g, p: effective_velocity(v, g, p, *SIEMENS_ENDS), (PERCENT,) * 3, (-1, 1, 0), UNIT),
    (lambda v, g, p: effective_velocity(v, g, p, *PAPER_ENDS), (PERCENT,) * 3, (1, -1, 0), UNIT),
    (effective_gain, (PERCENT,) * 2, (-1, 0), UNIT),
    (lambda e: squashed_exponential(e, 0.1, 2.0, 0.5), (EXPONENTIAL,), (1,), UNIT),
    (lambda e: squashed_exponential(e, 0.05, 1.0, 0.0), (EXPONENTIAL,), (1,), (0.5, 1.0)),
    (lambda *u: noise_component(*u, SIEMENS.parameters), (EXPONENTIAL, *(UNIT,) * 3), (1, 1, -1, 1), UNIT),
    (lambda *u: noise_component(*u, PAPER.parameters), (EXPONENTIAL, *(UNIT,) * 3), (1, 1, -1, 1), UNIT),
    (update_mu, (MU, UNIT, UNIT), (0, 0, 1), MU),
    (lambda *x: amplification(*x, 1.2), (MU, MU, UNIT, UNIT, (-8.3, 8.3)), (0, 0, 1, 1, 1), UNIT),
    (basic_fatigue, (PERCENT,) * 2, (-1, -1), (0.0, 300.0)),
    (fatigue, ((0.0, 300.0), UNIT), (1, 1), (0.0, 300.0)),
    (reward, (COST, (0.0, 300.0)), (-1, -1), (-5900.0, 25.0)),
    (effective_shift, (PERCENT,) * 2, (1, -1), (-1.5, 1.5)),
    (lambda x, delta: steer(x, D_G, delta), (PERCENT, (-3.0, 3.0)), (1, 1), PERCENT),
    *((lambda he, phi=phi: radius(phi, he), ((-1.5, 1.5),), (1,), (-2.0, 2.0)) for phi in range(-6, 7)),
    *((lambda he, phi=phi: penalty(phi, he), ((-1.5, 1.5),), (0,), (-1.0, 1.2304)) for phi in range(-6, 7)),
]
variants = pytest.mark.parametrize("variant", [SIEMENS, PAPER], ids=["siemens", "paper"])


@pytest.mark.parametrize(("equation", "arguments", "value"), VALUES)
def test_an_equation_has_its_value_by_hand(equation, arguments, value):
    assert equation(*arguments) == pytest.approx(value, rel=1e-14, abs=0.0)


@pytest.mark.parametrize(("equation", "arguments", "signs", "bounds"), LAWS)
@tries(200)
@given(data=st.data())
def test_an_equation_keeps_its_range_and_direction(equation, arguments, signs, bounds, data):
    """From one point to another of which one argument is larger."""
    low = [data.draw(st.floats(*each)) for each in arguments]
    value, slack = equation(*low), 1e-14 * max(map(abs, bounds))
    assert bounds[0] - slack <= value <= bounds[1] + slack
    for i, (each, sign) in enumerate(zip(arguments, signs, strict=True)):
        high = [*low[:i], data.draw(st.floats(low[i], each[1])), *low[i + 1 :]]
        assert sign * (equation(*high) - value) >= -slack


def test_the_step_sizes_are_those_of_the_authors_code():
    """That of the shift is one unit in the last place below the double nearest to 20 sin(15°) / 0.9."""
    with mpmath.workdps(50):
        nearest = float(20 * mpmath.sin(mpmath.pi / 12) / mpmath.mpf("0.9"))
    assert [1.0, 10.0, math.nextafter(nearest, 0.0)] == [D_V, D_G, D_H]


def test_a_run_away_takes_15_steps_to_its_cap():
    mu, steps = 1.2, 0  # 1.2 · 1.1¹⁴ = 4.557, 1.2 · 1.1¹⁵ = 5.013
    while mu < 5.0:
        mu, steps = update_mu(mu, 0.5, 0.0), steps + 1
    assert steps == 15
    assert update_mu(mu, 0.5, 0.0) == 5.0


def test_the_first_cost_fills_the_history_of_its_own_lane():
    history = np.zeros((10, 2))
    history[:, 1] = np.arange(1.0, 11.0)
    remember(np.array([7.5, 99.0]), history)
    assert history[:, 0].tolist() == [7.5] * 10
    assert history[:, 1].tolist() == [99.0, *range(1, 10)]


@variants
def test_a_cost_is_seen_after_5_to_9_steps_by_its_weights(variant):
    """A cost of 1 in a history of nothing, which is then forgotten."""
    history, response = np.zeros((10, 1)), []
    history[0] = 1.0
    for _ in range(11):
        response.append(convolved_cost(history, 0, variant.convolution_weights))
        history[:, 0] = [0.0, *history[:9, 0]]
    assert response == [0.0] * 5 + list(variant.convolution_weights) + [0.0]
