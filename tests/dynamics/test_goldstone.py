"""The penalty m of the mis-calibration: a linearly biased Goldstone potential, and its tables."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from helpers.examples import tries
from hypothesis import given
from hypothesis import strategies as st

from ibdata.dynamics.miscalibration import (
    ALPHA,
    BETA,
    KAPPA,
    OMEGA_EXPONENT,
    OMEGA_FACTOR,
    R_MIN,
    R_OPT,
    RHO_S,
    penalty,
    radius,
)

examples = tries(400)
mp = mpmath.mp.clone()
mp.dps = 60
PHIS = range(-6, 7)
GRID = np.linspace(-1.5, 1.5, 2001)
phis = st.integers(-6, 6)
shifts = st.floats(-1.5, 1.5)


def constants():
    """α, β, κ of Eqs. (34) to (39)."""
    epsilon = mp.cbrt(1 + mp.sqrt(2)) / mp.sqrt(3)
    zeta = epsilon + 1 / (3 * epsilon)
    bias = 8 * mp.sqrt(mp.mpf(2) / 27)
    lambda_ = 2 * zeta**2 - zeta**4 + bias * zeta
    return 2 / lambda_, 1 / lambda_, -bias / lambda_


def radii(phi):
    """|ρˢ|, |r_opt| and |r_min| for φ >= 0, Eqs. (18) and (43) to (47), with ϱ = 1."""
    _, beta, kappa = constants()
    rho_s = mp.sin(mp.pi * phi / 12)
    q = kappa * rho_s / (8 * beta)
    if phi == 3:  # q² = 1/27: the square root is 0, and both branches of (44) are 2/√3
        assert abs(q * q - mp.mpf(1) / 27) < mp.mpf(10) ** -55
        r_min = 2 / mp.sqrt(3)
    elif q < -mp.sqrt(mp.mpf(1) / 27):
        u = mp.cbrt(-q + mp.sqrt(q * q - mp.mpf(1) / 27))
        r_min = u + 1 / (3 * u)
    else:
        r_min = mp.sqrt(mp.mpf(4) / 3) * mp.cos(mp.acos(-q * mp.sqrt(27)) / 3)
    return rho_s, max(rho_s, mp.sin(mp.pi / 12)), r_min  # 2 z = sin 15°


def test_the_constants_are_the_rounded_values_of_the_appendix():
    alpha, beta, kappa = constants()
    assert (float(alpha), float(beta), float(kappa)) == (ALPHA, BETA, KAPPA)
    assert [round(x, 10) for x in (ALPHA, BETA, KAPPA)] == [0.5849066324, 0.2924533162, -0.6367656874]


@pytest.mark.parametrize("phi", range(7))
def test_the_tables_are_the_rounded_values_of_the_appendix(phi):
    rho_s, r_opt, r_min = radii(phi)
    exponent = (2 - r_opt) / (2 - r_min)
    factor = (2 - r_min) / (2 - r_opt) ** exponent
    table = [t[phi] for t in (RHO_S, R_OPT, R_MIN, OMEGA_EXPONENT, OMEGA_FACTOR)]
    assert table == [float(x) for x in (rho_s, r_opt, r_min, exponent, factor)]
    assert {len(t) for t in (RHO_S, R_OPT, R_MIN, OMEGA_EXPONENT, OMEGA_FACTOR)} == {7}


@pytest.mark.parametrize("phi", range(7))
def test_the_radius_of_least_penalty_is_a_root(phi):
    """dm/dω = -2 α ω + 4 β ω³ + κ ρˢ = 0 at |r_min|, whatever branch it came from."""
    alpha, beta, kappa = constants()
    rho_s, _, r_min = radii(phi)
    assert abs(-2 * alpha * r_min + 4 * beta * r_min**3 + kappa * rho_s) < mp.mpf(10) ** -50


@pytest.mark.parametrize("phi", PHIS)
def test_the_radius_takes_the_optimal_shift_to_its_own(phi):
    r_opt, r_min = R_OPT[abs(phi)], R_MIN[abs(phi)]
    assert radius(phi, r_opt) == pytest.approx(r_min, rel=1e-15)
    assert radius(phi, 0.5 * r_opt) == pytest.approx(0.5 * r_min, rel=1e-15)  # linear up to there
    assert radius(phi, 2.0) == pytest.approx(2.0, rel=1e-15)


@pytest.mark.parametrize("phi", PHIS)
def test_the_radius_is_continuous_at_the_optimum(phi):
    r_opt = R_OPT[abs(phi)]
    above = np.nextafter(r_opt, 2.0)
    assert radius(phi, above) == pytest.approx(radius(phi, r_opt), abs=1e-15)
    assert radius(phi, -above) == pytest.approx(radius(phi, -r_opt), abs=1e-15)


@pytest.mark.parametrize("phi", PHIS)
@pytest.mark.parametrize("he", [-1.5, -0.9, -0.4, -0.05, 0.0, 0.2, 0.7, 1.1, 1.5])
def test_the_penalty_is_that_of_the_appendix(phi, he):
    """Eqs. (17), (18) and (40) to (47) at 60 digits, with the sign of φ kept in ρˢ."""
    alpha, beta, kappa = constants()
    rho_s, r_opt, r_min = radii(abs(phi))
    size = mp.mpf(abs(he))
    if size <= r_opt:
        omega = size * r_min / r_opt
    else:
        exponent = (2 - r_opt) / (2 - r_min)
        omega = r_min + (2 - r_min) / (2 - r_opt) ** exponent * (size - r_opt) ** exponent
    omega = omega if he > 0 else -omega
    m = -alpha * omega**2 + beta * omega**4 + kappa * (rho_s if phi >= 0 else -rho_s) * omega
    assert penalty(phi, he) == pytest.approx(float(m), abs=5e-15)


@pytest.mark.parametrize(
    ("size", "m"), list(enumerate((-0.2925, -0.4627, -0.6301, -0.7799, -0.8982, -0.9739, -1.0)))
)
def test_the_least_penalty_lies_at_the_optimal_shift(size, m):
    for phi, sign in ((size, 1.0), (-size, -1.0)):
        least = penalty(phi, sign * R_OPT[size])
        assert round(least, 4) == m
        assert least <= min(penalty(phi, he) for he in GRID) + 1e-15


@examples
@given(phis, shifts)
def test_the_penalty_is_the_same_mirrored(phi, he):
    assert penalty(-phi, -he) == penalty(phi, he)
    assert -1.0 - 1e-15 <= penalty(phi, he) <= 1.2304
