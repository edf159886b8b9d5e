"""Sine and cosine against mpmath."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from ibdata.numerics.circle import TWO_PI, cosine, sine

TURNS = np.concatenate(
    [np.random.default_rng(0).uniform(-2.0, 2.0, 1000), np.random.default_rng(1).uniform(-1e6, 1e6, 200)]
)


@pytest.mark.parametrize(("function", "exact"), [(cosine, mpmath.cospi), (sine, mpmath.sinpi)])
def test_the_error_is_below_that_of_a_double(function, exact):
    with mpmath.workprec(120):
        errors = [abs(exact(2 * mpmath.mpf(float(x))) - mpmath.mpf(float(function(x)))) for x in TURNS]
    assert max(errors) < 2e-16


@pytest.mark.parametrize("whole", [-3.0, 0.0, 2.0, 1e9])
def test_quarters_of_a_turn_are_exact(whole):
    quarters = [whole + x for x in (0.0, 0.25, 0.5, 0.75)]
    assert [cosine(x) for x in quarters] == [1.0, 0.0, -1.0, 0.0]
    assert [sine(x) for x in quarters] == [0.0, 1.0, 0.0, -1.0]
    assert not any(np.signbit(cosine(x)) for x in quarters if cosine(x) == 0.0)


def test_the_constant_is_its_formula_rounded_to_a_double():
    with mpmath.workprec(200):
        assert float(2 * mpmath.pi) == TWO_PI
