"""Equations at their edges and the moving setpoint, by hand. Their doctests hold a value of each.

All equations together, in the order of a step, are compared with the published package and with a second
implementation of the printed ones in `tests/reference`.
"""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from helpers import printed_equations as printed
from helpers import tries
from hypothesis import given
from hypothesis import strategies as st

from ibdata.dynamics import PAPER, SIEMENS
from ibdata.dynamics.consumption import (
    consumption,
    convolved_cost,
    expected_consumption,
    operational_cost,
    remember,
)
from ibdata.dynamics.fatigue import amplification, basic_fatigue, bernoulli, noise_component, update_mu
from ibdata.dynamics.miscalibration import effective_shift
from ibdata.dynamics.setpoint import D_G, D_H, D_V, clip, drift, segment_length, segment_rate, steer

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


SMALLEST, LARGEST = 2.0**-53, 1.0 - 2.0**-53
DRAWS = [f"uniform_drift_{name}" for name in ("length", "rate", "zero", "flip")]
uniforms = st.floats(SMALLEST, LARGEST)
# Multiples of 1/64 are added and mirrored without rounding.
setpoints = st.integers(0, 6400).map(lambda i: i / 64.0)
rates = st.integers(-64, 64).map(lambda i: i / 64.0)
# variant, setpoint, rate and the uniform of the flip within a segment; setpoint and rate afterwards
STEPS = [
    # The paper turns before the setpoint moves: an outward rate at a bound serves in this very step.
    (PAPER, (100.0, 0.5, 0.4), (99.5, -0.5)),
    (PAPER, (0.0, -0.5, 0.4), (0.5, 0.5)),
    (PAPER, (100.0, 0.5, 0.5), (100.0, 0.5)),  # z < ½, strictly
    (PAPER, (100.0, -0.5, 0.4), (100.0, 0.5)),  # an inward rate may turn outwards
    (PAPER, (99.75, 0.5, 0.4), (100.0, 0.5)),
    # The authors' code turns after it has moved and was clipped: a new sign serves the next step.
    (SIEMENS, (100.0, 0.5, 0.4), (100.0, -0.5)),
    (SIEMENS, (0.25, -0.5, 0.4), (0.0, 0.5)),
    (SIEMENS, (100.0, 0.5, 0.5), (100.0, 0.5)),
    (SIEMENS, (100.0, -0.5, 0.4), (99.5, -0.5)),
    (SIEMENS, (99.75, 0.5, 0.4), (100.0, -0.5)),
    (SIEMENS, (99.5, 0.5, 0.4), (100.0, 0.5)),  # 100 is in
]
variants = pytest.mark.parametrize("variant", [SIEMENS, PAPER], ids=["siemens", "paper"])


@variants
def test_evenly_spaced_uniforms_give_every_length_once(variant):
    n = variant.drift_length
    assert [segment_length((i + 0.5) / n, float(n)) for i in range(n)] == list(range(1, n + 1))
    assert (segment_length(SMALLEST, float(n)), segment_length(LARGEST, float(n))) == (1, n)


def test_one_rate_in_ten_is_zero_and_the_others_are_uniform():
    found = [segment_rate(0.75, (i + 0.5) / 100.0, -1.0, 1.0) for i in range(100)]
    assert found == [0.0] * 10 + [0.5] * 90  # -1 + 2 · 0.75


@pytest.mark.parametrize(("variant", "before", "after"), STEPS)
def test_a_step_at_a_bound_follows_the_rule_of_its_variant(variant, before, after):
    p, b, u = before
    assert drift(p, b, 3, 0.5, 0.5, 0.5, u, variant.parameters) == (*after, 2)


@variants
def test_a_segment_of_three_steps_is_followed_by_a_new_one(variant):
    """A draw of 0.025 gives l = 1 + ⌊2.475⌋ = 3 (or 1 + ⌊2.5⌋); rates drawn within a segment are ignored."""
    p, b, left, seen = 50.0, 0.0, 0, []
    for u_rate in (0.75, 0.1, 0.2, 0.5625, 0.3, 0.4, 0.875):
        p, b, left = drift(p, b, left, 0.025, u_rate, 0.5, 0.5, variant.parameters)
        seen.append((left, b))
    low, high = variant.drift_rate
    first, second, third = (low + (high - low) * u for u in (0.75, 0.5625, 0.875))
    assert seen == [(2, first), (1, first), (0, first), (2, second), (1, second), (0, second), (2, third)]
    assert p == 50.0 + 3 * first + 3 * second + third


@tries(150)
@given(p=setpoints, b=rates, left=st.integers(0, 99), u=st.tuples(uniforms, uniforms, uniforms, uniforms))
def test_any_step_is_the_printed_one_at_both_bounds(p, b, left, u):
    printed_one = printed.setpoint(p, b, left, dict(zip(DRAWS, u, strict=True)))
    assert drift(p, b, left, *u, PAPER.parameters) == printed_one
    for variant in (SIEMENS, PAPER) if left > 0 else ():
        p_next, b_next, left_next = drift(p, b, left, *u, variant.parameters)
        mirrored = drift(100.0 - p, -b, left, *u, variant.parameters)
        assert mirrored == (100.0 - p_next, -b_next, left_next)
