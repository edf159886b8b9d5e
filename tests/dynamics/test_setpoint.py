"""The moving setpoint: drawn segments, and both rules at the bounds."""

from __future__ import annotations

import pytest
from helpers import printed_equations as printed
from helpers.examples import tries
from hypothesis import given
from hypothesis import strategies as st

from ibdata.dynamics import PAPER, SIEMENS
from ibdata.dynamics.setpoint import drift, segment_length, segment_rate

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


@tries(300)
@given(p=setpoints, b=rates, left=st.integers(0, 99), u=st.tuples(uniforms, uniforms, uniforms, uniforms))
def test_any_step_is_the_printed_one_and_treats_both_bounds_alike(p, b, left, u):
    printed_one = printed.setpoint(p, b, left, dict(zip(DRAWS, u, strict=True)))
    assert drift(p, b, left, *u, PAPER.parameters) == printed_one
    for variant in (SIEMENS, PAPER) if left > 0 else ():
        p_next, b_next, left_next = drift(p, b, left, *u, variant.parameters)
        mirrored = drift(100.0 - p, -b, left, *u, variant.parameters)
        assert mirrored == (100.0 - p_next, -b_next, left_next)
