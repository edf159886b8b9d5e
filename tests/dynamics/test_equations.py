"""Equations at their edges, by hand. Their doctests hold a value of each.

All equations together, in the order of a step, are compared with the published package and with a second
implementation of the printed ones in `tests/reference`.
"""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

from ibdata.dynamics import PAPER, SIEMENS
from ibdata.dynamics.consumption import consumption, expected_consumption
from ibdata.dynamics.fatigue import amplification, basic_fatigue, bernoulli, noise_component, update_mu
from ibdata.dynamics.miscalibration import effective_shift
from ibdata.dynamics.operational_cost import convolved_cost, operational_cost, remember
from ibdata.dynamics.steering import D_G, D_H, D_V, clip, steer

TANH = math.tanh(0.1)  # 2 (σ(0.1 e) - ½) at e = 2
SQUASHED = 1.0 / (1.0 + math.exp(-0.1))  # σ(0.05 e) at e = 2
BIFURCATED = 1.0 / (1.0 + math.exp(-2.8))  # σ(2.4 + 0.4 z) at z = 1
VALUES = [
    (expected_consumption, (70.0, -0.5, 0.0), 57.5),  # 70 - 12.5
    (expected_consumption, (70.0, -1.0, 1.0), 70.0),  # the best penalty cancels the offset
    (consumption, (100.0, 1.0, 0.02), 103.0),  # standard deviation 1 + 2
    (bernoulli, (0.29, 0.3, 0.0, 1.0), 1.0),
    (bernoulli, (0.30, 0.3, 0.0, 1.0), 0.0),  # u < p, strictly
    (bernoulli, (0.0005, 0.0, 0.001, 0.999), 1.0),  # the clipped probability is 0.001
    (bernoulli, (0.9995, 1.0, 0.001, 0.999), 0.0),
    (noise_component, (2.0, 0.5, 0.1, 0.8, SIEMENS.parameters), TANH + (1.0 - TANH) * 0.4),
    (noise_component, (2.0, 0.5, 0.1, 0.8, PAPER.parameters), SQUASHED + (1.0 - SQUASHED) * 0.4),
    (noise_component, (2.0, 0.5, 0.9, 0.8, PAPER.parameters), SQUASHED),
    (update_mu, (3.0, 0.05, 0.9), 0.05),  # reset at 0.05 and below, whatever μ was
    (update_mu, (3.0, 0.0500001, 0.9), 3.3),  # above 0.05 it runs away: 1.1 · 3
    (update_mu, (1.2, 0.5, 0.9), 1.32),  # from 1.2 on
    (update_mu, (1.1999, 0.5, 0.3), 1.17991),  # 0.9 · 1.1999 + 0.1
    (update_mu, (4.8, 0.5, 0.9), 5.0),  # 5.28 is capped
    (amplification, (1.1, 1.19, 0.2, 0.3, 1.0, 1.2), 0.3),  # max(0.2, 0.3)
    (amplification, (1.2, 0.0, 0.2, 0.3, 1.0, 1.2), BIFURCATED),  # the threshold itself counts
    (amplification, (4.99, 4.99, 0.2, 0.3, 1.0, 5.0), 0.3),
    (amplification, (4.99, 5.0, 0.2, 0.3, 1.0, 5.0), BIFURCATED),
    (basic_fatigue, (100.0, 100.0), 0.0),  # 50 - 100 is below zero
    (operational_cost, (100.0, 0.0, 0.0), math.exp(2.0)),  # each coefficient alone
    (operational_cost, (0.0, 100.0, 0.0), math.exp(4.0)),
    (operational_cost, (0.0, 0.0, 100.0), math.exp(2.5)),
    (effective_shift, (70.0, 0.0), 1.5),  # 2 is clipped
    (effective_shift, (0.0, 100.0), -1.5),
    (steer, (50.0, D_V, -0.25), 49.75),
    (steer, (3.0, D_G, -1.0), 0.0),  # -7 is clipped
    (steer, (50.0, D_G, -1e300), 40.0),  # an action beyond 1 acts as 1
    (clip, (-2.0, -1.0, 4.0), -1.0),
    (clip, (4.5, -1.0, 4.0), 4.0),
]


@pytest.mark.parametrize(("equation", "arguments", "value"), VALUES)
def test_an_equation_has_its_value_by_hand(equation, arguments, value):
    assert equation(*arguments) == pytest.approx(value, rel=1e-14, abs=0.0)


def test_the_step_sizes_are_those_of_the_authors_code():
    """That of the shift is one unit in the last place below the double nearest to 20 sin(15°) / 0.9."""
    with mpmath.workdps(50):
        nearest = float(20 * mpmath.sin(mpmath.pi / 12) / mpmath.mpf("0.9"))
    assert [1.0, 10.0, math.nextafter(nearest, 0.0)] == [D_V, D_G, D_H]


def test_the_first_cost_fills_the_history_of_its_own_lane():
    history = np.zeros((10, 2))
    history[:, 1] = np.arange(1.0, 11.0)
    remember(np.array([7.5, 99.0]), history)
    assert history[:, 0].tolist() == [7.5] * 10
    assert history[:, 1].tolist() == [99.0, *range(1, 10)]


@pytest.mark.parametrize("variant", [SIEMENS, PAPER], ids=["siemens", "paper"])
def test_a_cost_is_seen_after_5_to_9_steps_by_its_weights(variant):
    """A cost of 1 in a history of nothing, which is then forgotten."""
    history, response = np.zeros((10, 1)), []
    history[0] = 1.0
    for _ in range(11):
        response.append(convolved_cost(history, 0, variant.convolution_weights))
        history[:, 0] = [0.0, *history[:9, 0]]
    assert response == [0.0] * 5 + list(variant.convolution_weights) + [0.0]
