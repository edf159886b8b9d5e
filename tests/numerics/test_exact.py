"""The transcendental functions and the cosine against mpmath, and their bits."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

from ibdata._numerics.exact import exp, exponential, log, logistic, normal, pow, tanh
from ibdata.policies.signals import TWO_PI, cosine

mp = mpmath.mp.clone()
mp.dps = 50
EPSILON = 2.0**-52
SMALLEST, LARGEST = 2.0**-53, 1.0 - 2.0**-53


def exact(x: float) -> mpmath.mpf:
    return mp.mpf(float(x))


def ulps(got: float, want: mpmath.mpf) -> float:
    """The error of a result in units in the last place of the true value."""
    return float(abs(exact(got) - want)) / math.ulp(float(want))


def relative(got: float, want: mpmath.mpf) -> float:
    return float(abs((exact(got) - want) / want))


def uniforms(rng: np.random.Generator) -> np.ndarray:
    """A grid (without ½, whose normal is 0), both tails down to 2⁻⁵³, and the joints of AS 241."""
    grid = np.arange(1, 200)[np.arange(1, 200) != 100] / 200.0
    tails = 10.0 ** rng.uniform(-15.9, -1.0, 60)
    joints = np.array([0.075, 0.925, math.exp(-25.0)])
    near = np.concatenate([joints * (1.0 + x) for x in (-1e-9, 0.0, 1e-9)])
    return np.concatenate([[SMALLEST, LARGEST], grid, tails, 1.0 - tails, near])


RNG = np.random.default_rng(1)
WIDE = RNG.uniform(-1.0, 1.0, 1500)
SMALL = 10.0 ** RNG.uniform(-300.0, 0.0, 500)
NEAR_ONE = 1.0 + np.concatenate([RNG.uniform(-0.01, 0.01, 1000), 10.0 ** RNG.uniform(-15.0, -1.0, 500)])
NEAR_FOLD = math.sqrt(2.0) * (1.0 + RNG.uniform(-1e-3, 1e-3, 500))  # where the power of two changes
# function, its true value, arguments, the largest error in units in the last place
ERRORS = {
    "exp": (exp, mp.exp, [np.linspace(-708.0, 709.0, 1418), RNG.uniform(-40.0, 40.0, 3000)], 1.0),
    "log": (log, mp.log, [1.0 / SMALL, SMALL, RNG.uniform(0.0, 1.0, 1500), NEAR_ONE, NEAR_FOLD], 2.0),
    "logistic": (logistic, lambda x: 1 / (1 + mp.exp(-x)), [708.0 * WIDE, 6.0 * WIDE], 2.5),
    "tanh": (tanh, mp.tanh, [20.0 * WIDE, WIDE, SMALL, -SMALL], 3.0),
    "exponential": (exponential, lambda u: -mp.log(u), [uniforms(RNG)], 2.0),
    "normal": (normal, lambda u: mp.sqrt(2) * mp.erfinv(2 * u - 1), [uniforms(RNG)], 16.0),  # 2e-15
}


@pytest.mark.parametrize(("function", "true", "arguments", "most"), ERRORS.values(), ids=ERRORS)
def test_the_error_is_a_few_units_in_the_last_place(function, true, arguments, most):
    assert max(ulps(function(x), true(exact(x))) for x in np.concatenate(arguments)) <= most


def test_pow_has_the_error_of_its_logarithm():
    rng = np.random.default_rng(3)
    for x, y in zip(10.0 ** rng.uniform(-17.0, 0.3, 1500), rng.uniform(1.25, 1.87, 1500), strict=True):
        bound = EPSILON * (1.0 + 2.0 * abs(y * math.log(x)))
        assert relative(pow(x, y), mp.power(exact(x), exact(y))) <= bound, (x, y)


def test_the_ends_of_the_ranges_are_finite():
    for x in (0.0, math.inf, 20.0, 1e300):
        assert tanh(x) == -tanh(-x) == (1.0 if x >= 20.0 else 0.0)
    assert math.isnan(tanh(math.nan))
    for x, bound in ((-708.5, -708.0), (-1e300, -708.0), (709.5, 709.0), (1e300, 709.0)):
        assert exp(x) == exp(bound)
        assert 0.0 < exp(x) < math.inf


@pytest.mark.parametrize("u", [SMALLEST, LARGEST])
def test_the_extreme_uniforms_give_finite_variates(u):
    # Φ⁻¹(2⁻⁵³) = -8.2095; -log 2⁻⁵³ = 53 · 0.693147 = 36.7368, -log(1 - 2⁻⁵³) = 1.1102e-16.
    assert abs(normal(u)) == pytest.approx(8.209536151601387, rel=1e-15)
    assert exponential(u) == pytest.approx(36.7368005696771 if u < 0.5 else 2.0**-53, rel=1e-14)


# From python -c "from ibdata._numerics.exact import exp; print(exp(-1.0).hex())", and so on, at 157c922 with
# numba 0.68.1 and numpy 2.4.6; with NUMBA_DISABLE_JIT=1 the bits were the same.
GOLDEN = [
    ((exp, -1.0), "0x1.78b56362cef38p-2"),
    ((exp, 4.25), "0x1.186bf136d679dp+6"),
    ((exp, 8.5), "0x1.332c4d2b7c4a1p+12"),
    ((log, 3.0), "0x1.193ea7aad030bp+0"),
    ((log, 1e-300), "-0x1.5963447f87fb5p+9"),
    ((pow, 0.3, 1.5), "0x1.50854f2c3d221p-3"),
    ((pow, 1.25, 1.74), "0x1.797414a78f7c6p+0"),
    ((logistic, 2.4), "0x1.d56a636946e58p-1"),
    ((logistic, -30.0), "0x1.a56e0c2ac7cbfp-44"),
    ((exponential, 0.1), "0x1.26bb1bbb55515p+1"),
    ((exponential, 0.999), "0x1.064670d979b73p-10"),
    ((normal, 0.3), "-0x1.0c7e39582c5fap-1"),
    ((normal, 0.01), "-0x1.29c5c4630ff0ep+1"),
    ((normal, 1e-13), "-0x1.d652ace3a0130p+2"),
    ((normal, 0.975), "0x1.f5c0331eeff82p+0"),
]


@pytest.mark.parametrize(("call", "bits"), GOLDEN)
def test_the_bits_are_those_of_the_first_release(call, bits):
    function, *arguments = call
    assert float(function(*arguments)).hex() == bits


TURNS = np.concatenate(
    [np.random.default_rng(0).uniform(-2.0, 2.0, 1000), np.random.default_rng(1).uniform(-1e6, 1e6, 200)]
)


def test_the_error_of_the_cosine_is_below_that_of_a_double():
    with mpmath.workprec(120):
        errors = [abs(mpmath.cospi(2 * mpmath.mpf(float(x))) - mpmath.mpf(float(cosine(x)))) for x in TURNS]
    assert max(errors) < 2e-16
    with mpmath.workprec(200):
        assert float(2 * mpmath.pi) == TWO_PI
