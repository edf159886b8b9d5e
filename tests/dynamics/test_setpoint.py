"""The moving setpoint: drawn segments, and both rules at the bounds."""

from __future__ import annotations

import pytest
from helpers.examples import tries
from hypothesis import given
from hypothesis import strategies as st

from ibdata.dynamics import PAPER, SIEMENS
from ibdata.dynamics.setpoint import (
    drift,
    moved,
    segment_length,
    segment_rate,
    turned_at_bound,
    turned_past_bound,
)

examples = tries(300)
SMALLEST, LARGEST = 2.0**-53, 1.0 - 2.0**-53
uniforms = st.floats(SMALLEST, LARGEST)
variants = pytest.mark.parametrize("variant", [SIEMENS, PAPER], ids=["siemens", "paper"])
# Multiples of 1/64 are added and mirrored without rounding.
setpoints = st.integers(0, 6400).map(lambda i: i / 64.0)
rates = st.integers(-64, 64).map(lambda i: i / 64.0)


@pytest.mark.parametrize(
    ("u", "longest", "length"),
    [(0.5, 100.0, 51), (0.5, 99.0, 50), (SMALLEST, 99.0, 1), (LARGEST, 99.0, 99), (LARGEST, 100.0, 100)],
)
def test_a_segment_length_is_one_plus_the_whole_part_of_longest_times_u(u, longest, length):
    assert segment_length(u, longest) == length


@variants
def test_evenly_spaced_uniforms_give_every_length_from_1_to_the_longest_once(variant):
    n = variant.drift_length
    assert [segment_length((i + 0.5) / n, float(n)) for i in range(n)] == list(range(1, n + 1))


def test_the_extreme_uniforms_give_the_shortest_and_the_longest_length():
    for longest in range(1, 1001):
        assert segment_length(SMALLEST, float(longest)) == 1
        assert segment_length(LARGEST, float(longest)) == longest


def test_a_segment_rate_is_uniform_in_its_range():
    assert segment_rate(0.75, 0.5, -1.0, 1.0) == 0.5  # -1 + 2 · 0.75
    assert segment_rate(0.75, 0.5, 0.0, 1.0) == 0.75


def test_one_rate_in_ten_is_zero():
    rates = [segment_rate(0.75, (i + 0.5) / 100.0, 0.0, 1.0) for i in range(100)]
    assert rates == [0.0] * 10 + [0.75] * 90


@variants
@examples
@given(u=uniforms, u_zero=uniforms)
def test_a_segment_rate_stays_in_its_range(variant, u, u_zero):
    low, high = variant.drift_rate
    assert low <= segment_rate(u, u_zero, low, high) <= high


@pytest.mark.parametrize(
    ("b", "p", "u", "flip", "after"),
    [
        (0.5, 100.0, 0.4, 0.5, -0.5),
        (0.5, 100.0, 0.5, 0.5, 0.5),  # z < ½, strictly
        (-0.5, 0.0, 0.4, 0.5, 0.5),
        (-0.5, 100.0, 0.4, 0.5, 0.5),  # the rule asks where p stands, not where it goes
        (0.5, 99.99, 0.4, 0.5, 0.5),
        (0.5, 100.0, 0.4, 0.0, 0.5),
    ],
)
def test_the_rate_turns_with_its_probability_at_a_bound(b, p, u, flip, after):
    assert turned_at_bound(b, p, u, flip) == after


@pytest.mark.parametrize(
    ("b", "p", "u", "flip", "after"),
    [
        (0.5, 99.75, 0.4, 0.5, -0.5),  # 100.25 is out
        (0.5, 99.75, 0.5, 0.5, 0.5),
        (0.5, 99.5, 0.4, 0.5, 0.5),  # 100 is in
        (-0.5, 0.25, 0.4, 0.5, 0.5),
        (-0.5, 100.0, 0.4, 0.5, -0.5),  # from the bound inwards nothing turns
        (0.5, 99.75, 0.4, 0.0, 0.5),
    ],
)
def test_the_rate_turns_with_its_probability_past_a_bound(b, p, u, flip, after):
    assert turned_past_bound(b, p, u, flip) == after


@examples
@given(setpoints, rates, uniforms, st.floats(0.0, 1.0))
def test_a_turn_changes_the_sign_only_and_never_without_its_probability(p, b, u, flip):
    for turned in (turned_at_bound, turned_past_bound):
        assert abs(turned(b, p, u, flip)) == abs(b)
        assert turned(b, p, u, 0.0) == b
        assert turned(b, 50.0, u, flip) == b


def test_the_setpoint_moves_by_its_rate_and_stops_at_the_bounds():
    assert moved(50.0, -0.75) == 49.25
    assert moved(99.5, 0.75) == 100.0
    assert moved(0.25, -0.75) == 0.0


@examples
@given(setpoints, rates)
def test_a_move_is_undone_by_the_opposite_rate_unless_a_bound_was_met(p, b):
    after = moved(p, b)
    assert 0.0 <= after <= 100.0
    assert after in (0.0, 100.0) or moved(after, -b) == p


@pytest.mark.parametrize("p", [0.0, 100.0])
def test_the_paper_flips_the_rate_before_the_setpoint_moves(p):
    """At a bound with an outward rate, z < ½ turns the setpoint in this very step; else it stays."""
    inward = 1.0 if p == 0.0 else -1.0
    k = PAPER.parameters
    assert drift(p, -0.5 * inward, 3, 0.5, 0.5, 0.5, 0.4, k) == (p + 0.5 * inward, 0.5 * inward, 2)
    assert drift(p, -0.5 * inward, 3, 0.5, 0.5, 0.5, 0.6, k) == (p, -0.5 * inward, 2)
    # An inward rate at a bound may turn outwards too: the printed rule does not look at its sign.
    assert drift(p, 0.5 * inward, 3, 0.5, 0.5, 0.5, 0.4, k) == (p, -0.5 * inward, 2)


@pytest.mark.parametrize("p", [0.0, 100.0])
def test_the_authors_code_flips_the_rate_after_the_setpoint_has_moved_and_was_clipped(p):
    """At a bound with an outward rate the setpoint stays for this step; a new sign serves the next one."""
    inward = 1.0 if p == 0.0 else -1.0
    k = SIEMENS.parameters
    assert drift(p, -0.5 * inward, 3, 0.5, 0.5, 0.5, 0.4, k) == (p, 0.5 * inward, 2)
    assert drift(p, -0.5 * inward, 3, 0.5, 0.5, 0.5, 0.6, k) == (p, -0.5 * inward, 2)
    assert drift(p, 0.5 * inward, 3, 0.5, 0.5, 0.5, 0.4, k) == (p + 0.5 * inward, 0.5 * inward, 2)


def test_a_step_past_a_bound_turns_the_rate_of_the_authors_code_only():
    assert drift(99.75, 0.5, 3, 0.5, 0.5, 0.5, 0.4, SIEMENS.parameters) == (100.0, -0.5, 2)
    assert drift(99.75, 0.5, 3, 0.5, 0.5, 0.5, 0.4, PAPER.parameters) == (100.0, 0.5, 2)


def test_a_segment_is_drawn_used_and_turned_in_the_same_step():
    # l = 1 + ⌊99 · 0.5⌋ = 50 and b = -1 + 2 · 0.75 = 0.5; 100.5 is out, so that b turns; 49 steps are left.
    assert drift(100.0, -0.25, 0, 0.5, 0.75, 0.5, 0.4, SIEMENS.parameters) == (100.0, -0.5, 49)
    # l = 1 + ⌊100 · 0.5⌋ = 51 and b = 0.75; it turns before the setpoint moves.
    assert drift(100.0, -0.25, 0, 0.5, 0.75, 0.5, 0.4, PAPER.parameters) == (99.25, -0.75, 50)


@variants
def test_a_segment_of_three_steps_is_counted_down_and_followed_by_a_new_one(variant):
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
@examples
@given(p=setpoints, b=rates, left=st.integers(0, 99), u=st.tuples(uniforms, uniforms, uniforms, uniforms))
def test_a_step_keeps_the_setpoint_in_its_bounds_and_the_rate_within_its_segment(variant, p, b, left, u):
    p_next, b_next, left_next = drift(p, b, left, *u, variant.parameters)
    assert 0.0 <= p_next <= 100.0
    assert abs(b_next) <= 1.0
    assert 0 <= left_next < variant.drift_length
    assert left == 0 or (abs(b_next) == abs(b) and left_next == left - 1)


@variants
@examples
@given(p=setpoints, b=rates, left=st.integers(1, 99), u_flip=uniforms)
def test_both_rules_treat_the_two_bounds_alike(variant, p, b, left, u_flip):
    k = variant.parameters
    up = drift(p, b, left, 0.5, 0.5, 0.5, u_flip, k)
    down = drift(100.0 - p, -b, left, 0.5, 0.5, 0.5, u_flip, k)
    assert down == (100.0 - up[0], -up[1], up[2])
