"""The moving setpoint: drawn segments, and both rules at the bounds."""

from __future__ import annotations

import pytest
from helpers.examples import tries
from hypothesis import given
from hypothesis import strategies as st

from ibdata.dynamics import PAPER, SIEMENS
from ibdata.dynamics.setpoint import drift, segment_length, segment_rate, turned_at_bound, turned_past_bound

SMALLEST, LARGEST = 2.0**-53, 1.0 - 2.0**-53
uniforms = st.floats(SMALLEST, LARGEST)
variants = pytest.mark.parametrize("variant", [SIEMENS, PAPER], ids=["siemens", "paper"])
# Multiples of 1/64 are added and mirrored without rounding.
setpoints = st.integers(0, 6400).map(lambda i: i / 64.0)
rates = st.integers(-64, 64).map(lambda i: i / 64.0)

# rule: (rate, setpoint, uniform, probability of a turn), the rate afterwards
TURNS = [
    (turned_at_bound, (0.5, 100.0, 0.4, 0.5), -0.5),
    (turned_at_bound, (0.5, 100.0, 0.5, 0.5), 0.5),  # z < ½, strictly
    (turned_at_bound, (-0.5, 0.0, 0.4, 0.5), 0.5),
    (turned_at_bound, (-0.5, 100.0, 0.4, 0.5), 0.5),  # the rule asks where p stands, not where it goes
    (turned_at_bound, (0.5, 99.99, 0.4, 0.5), 0.5),
    (turned_at_bound, (0.5, 100.0, 0.4, 0.0), 0.5),
    (turned_past_bound, (0.5, 99.75, 0.4, 0.5), -0.5),  # 100.25 is out
    (turned_past_bound, (0.5, 99.75, 0.5, 0.5), 0.5),
    (turned_past_bound, (0.5, 99.5, 0.4, 0.5), 0.5),  # 100 is in
    (turned_past_bound, (-0.5, 0.25, 0.4, 0.5), 0.5),
    (turned_past_bound, (-0.5, 100.0, 0.4, 0.5), -0.5),  # from the bound inwards nothing turns
    (turned_past_bound, (0.5, 99.75, 0.4, 0.0), 0.5),
]
# variant, (setpoint, rate, steps left, uniforms of length, rate, zero and flip), the three afterwards
STEPS = [
    # The paper turns before the setpoint moves: an outward rate at a bound serves in this very step.
    (PAPER, (100.0, 0.5, 3, 0.5, 0.5, 0.5, 0.4), (99.5, -0.5, 2)),
    (PAPER, (0.0, -0.5, 3, 0.5, 0.5, 0.5, 0.4), (0.5, 0.5, 2)),
    (PAPER, (100.0, 0.5, 3, 0.5, 0.5, 0.5, 0.6), (100.0, 0.5, 2)),
    (PAPER, (100.0, -0.5, 3, 0.5, 0.5, 0.5, 0.4), (100.0, 0.5, 2)),  # an inward rate may turn outwards
    (PAPER, (99.75, 0.5, 3, 0.5, 0.5, 0.5, 0.4), (100.0, 0.5, 2)),
    # The authors' code turns after it has moved and was clipped: a new sign serves the next step.
    (SIEMENS, (100.0, 0.5, 3, 0.5, 0.5, 0.5, 0.4), (100.0, -0.5, 2)),
    (SIEMENS, (0.0, -0.5, 3, 0.5, 0.5, 0.5, 0.4), (0.0, 0.5, 2)),
    (SIEMENS, (100.0, 0.5, 3, 0.5, 0.5, 0.5, 0.6), (100.0, 0.5, 2)),
    (SIEMENS, (100.0, -0.5, 3, 0.5, 0.5, 0.5, 0.4), (99.5, -0.5, 2)),
    (SIEMENS, (99.75, 0.5, 3, 0.5, 0.5, 0.5, 0.4), (100.0, -0.5, 2)),
    # A segment is drawn, used and turned in one step: l = 1 + ⌊99 · ½⌋ = 50 or 51; b = -1 + 2 · ¾ or ¾.
    (SIEMENS, (100.0, -0.25, 0, 0.5, 0.75, 0.5, 0.4), (100.0, -0.5, 49)),
    (PAPER, (100.0, -0.25, 0, 0.5, 0.75, 0.5, 0.4), (99.25, -0.75, 50)),
]


@variants
def test_evenly_spaced_uniforms_give_every_length_once(variant):
    n = variant.drift_length
    assert [segment_length((i + 0.5) / n, float(n)) for i in range(n)] == list(range(1, n + 1))


def test_the_extreme_uniforms_give_the_extreme_lengths():
    for longest in range(1, 1001):
        assert segment_length(SMALLEST, float(longest)) == 1
        assert segment_length(LARGEST, float(longest)) == longest


def test_one_rate_in_ten_is_zero_and_the_others_are_uniform():
    found = [segment_rate(0.75, (i + 0.5) / 100.0, -1.0, 1.0) for i in range(100)]
    assert found == [0.0] * 10 + [0.5] * 90  # -1 + 2 · 0.75


@pytest.mark.parametrize(("rule", "arguments", "after"), TURNS)
def test_a_rate_turns_with_its_probability(rule, arguments, after):
    assert rule(*arguments) == after


@pytest.mark.parametrize(("variant", "before", "after"), STEPS)
def test_a_step_at_a_bound_follows_the_rule_of_its_variant(variant, before, after):
    assert drift(*before, variant.parameters) == after


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


@variants
@tries(300)
@given(p=setpoints, b=rates, left=st.integers(0, 99), u=st.tuples(uniforms, uniforms, uniforms, uniforms))
def test_any_step_keeps_the_bounds_and_treats_both_alike(variant, p, b, left, u):
    p_next, b_next, left_next = drift(p, b, left, *u, variant.parameters)
    assert 0.0 <= p_next <= 100.0
    assert abs(b_next) <= 1.0
    assert 0 <= left_next < variant.drift_length
    if left > 0:
        assert (abs(b_next), left_next) == (abs(b), left - 1)
        mirrored = drift(100.0 - p, -b, left, *u, variant.parameters)
        assert mirrored == (100.0 - p_next, -b_next, left_next)
