"""Mis-calibration: the turning direction φ with its domain δ and response ψ, and the penalty m.

The paper's figures 3a to 3c are played through `step` in `tests/reference/test_figures.py`.
"""

from __future__ import annotations

import itertools

import mpmath
import pytest
from helpers import printed_equations as printed

from ibdata.dynamics.miscalibration import (
    ALPHA,
    BETA,
    KAPPA,
    OMEGA_EXPONENT,
    OMEGA_FACTOR,
    PHI_MAX,
    R_MIN,
    R_OPT,
    RHO_S,
    SAFE_ZONE,
    penalty,
    update_direction,
)

mp = mpmath.mp.clone()
mp.dps = 60
SIGNS, PHIS = (-1, 1), range(-PHI_MAX, PHI_MAX + 1)
SHIFTS = (-1.5, -0.9, -0.4, -0.13, -SAFE_ZONE, -0.05, 0.0, 0.1, SAFE_ZONE, 0.13, 0.2, 0.7, 1.1, 1.5)


def test_the_direction_turns_as_printed():
    """As the second implementation of equations (9) to (16), at every state and on both sides of z."""
    for before in itertools.product(SIGNS, SIGNS, PHIS, SHIFTS):
        assert update_direction(*before) == printed.latents_of_miscalibration(*before), before


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
        r_min = 2 / mp.sqrt(3)
    elif q < -mp.sqrt(mp.mpf(1) / 27):
        u = mp.cbrt(-q + mp.sqrt(q * q - mp.mpf(1) / 27))
        r_min = u + 1 / (3 * u)
    else:
        r_min = mp.sqrt(mp.mpf(4) / 3) * mp.cos(mp.acos(-q * mp.sqrt(27)) / 3)
    return rho_s, max(rho_s, mp.sin(mp.pi / 12)), r_min  # 2 z = sin 15°


def test_constants_and_tables_are_the_rounded_values_of_the_appendix():
    assert tuple(map(float, (mp.sin(mp.pi / 12) / 2, *constants()))) == (SAFE_ZONE, ALPHA, BETA, KAPPA)  # 15°
    assert round(SAFE_ZONE, 4) == 0.1294  # the paper prints 0.1309, which is π/24
    assert [round(x, 10) for x in (ALPHA, BETA, KAPPA)] == [0.5849066324, 0.2924533162, -0.6367656874]
    rows = []
    for phi in range(7):
        rho_s, r_opt, r_min = radii(phi)
        exponent = (2 - r_opt) / (2 - r_min)
        factor = (2 - r_min) / (2 - r_opt) ** exponent
        rows.append(tuple(map(float, (rho_s, r_opt, r_min, exponent, factor))))
    assert list(zip(RHO_S, R_OPT, R_MIN, OMEGA_EXPONENT, OMEGA_FACTOR, strict=True)) == rows


def test_the_penalty_is_that_of_the_appendix():
    """Eqs. (17), (18) and (40) to (47) at 60 digits, with the sign of φ kept in ρˢ."""
    alpha, beta, kappa = constants()
    for phi, he in itertools.product(PHIS, SHIFTS):
        rho_s, r_opt, r_min = radii(abs(phi))
        size, exponent = mp.mpf(abs(he)), (2 - r_opt) / (2 - r_min)
        omega = size * r_min / r_opt
        if size > r_opt:
            omega = r_min + (2 - r_min) / (2 - r_opt) ** exponent * (size - r_opt) ** exponent
        omega = omega if he > 0 else -omega
        m = -alpha * omega**2 + beta * omega**4 + kappa * (rho_s if phi >= 0 else -rho_s) * omega
        assert penalty(phi, he) == pytest.approx(float(m), abs=5e-15), (phi, he)
