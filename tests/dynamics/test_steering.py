"""Steering: the effect of an action on velocity, gain and shift."""

from __future__ import annotations

import math

import mpmath
import pytest
from helpers.examples import tries
from hypothesis import given
from hypothesis import strategies as st

from ibdata.dynamics.steering import D_G, D_H, D_V, clip, steer

examples = tries(300)
finite = st.floats(allow_nan=False, allow_infinity=False)
percent = st.floats(0.0, 100.0)
sizes = st.sampled_from([D_V, D_G, D_H])


def test_the_step_sizes_are_those_of_the_paper():
    assert (D_V, D_G) == (1.0, 10.0)
    assert round(D_H, 4) == 5.7515


def test_the_step_size_of_the_shift_is_rounded_as_the_authors_code_rounds_it():
    """One unit in the last place below the double that is nearest to 20 sin(15°) / 0.9."""
    with mpmath.workdps(50):
        nearest = float(20 * mpmath.sin(mpmath.pi / 12) / mpmath.mpf("0.9"))  # 15° = π/12
    assert math.nextafter(nearest, 0.0) == D_H


@pytest.mark.parametrize(
    ("x", "d", "delta", "after"),
    [
        (50.0, D_V, 1.0, 51.0),
        (50.0, D_V, -0.25, 49.75),
        (100.0, D_V, 1.0, 100.0),  # held at the bound
        (0.0, D_V, -1.0, 0.0),
        (50.0, D_G, 0.5, 55.0),  # 50 + 10 · 0.5
        (95.0, D_G, 1.0, 100.0),  # 105 is clipped
        (3.0, D_G, -1.0, 0.0),  # -7 is clipped
        (50.0, D_H, 1.0, 55.75153433561157),  # 50 + 20 · 0.258819045102521 / 0.9
        (97.0, D_H, 1.0, 100.0),
        (5.0, D_H, -1.0, 0.0),
    ],
)
def test_a_steering_moves_by_its_step_size_within_its_bounds(x, d, delta, after):
    assert steer(x, d, delta) == pytest.approx(after, rel=1e-15, abs=0.0)


@examples
@given(percent, sizes, finite)
def test_a_steering_stays_in_its_bounds_for_any_action(x, d, delta):
    assert 0.0 <= steer(x, d, delta) <= 100.0


@examples
@given(percent, sizes, st.floats(1.0, 1e300))
def test_an_action_beyond_one_acts_as_one(x, d, delta):
    assert steer(x, d, delta) == steer(x, d, 1.0)
    assert steer(x, d, -delta) == steer(x, d, -1.0)


@examples
@given(percent, sizes, st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_a_larger_action_never_gives_a_smaller_steering(x, d, a, b):
    low, high = sorted((a, b))
    assert steer(x, d, low) <= steer(x, d, high)


@pytest.mark.parametrize(("x", "clipped"), [(-2.0, -1.0), (-1.0, -1.0), (0.3, 0.3), (4.0, 4.0), (4.5, 4.0)])
def test_clip_returns_the_nearest_number_of_the_interval(x, clipped):
    assert clip(x, -1.0, 4.0) == clipped


@examples
@given(finite, finite, finite)
def test_clip_is_the_median_of_its_arguments(x, a, b):
    low, high = sorted((a, b))
    assert clip(x, low, high) == sorted((x, low, high))[1]
