"""Mis-calibration: the direction φ, which the effective shift turns, and the penalty m.

The penalty is a linearly biased Goldstone potential. Its radii depend on |φ| alone, which has seven values,
so they are tabulated: the formulas of the paper's appendix, evaluated to 60 digits and rounded to doubles.
"""

from __future__ import annotations

from ibdata._numerics.compiled import compiled
from ibdata._numerics.exact import clip, pow

PHI_MAX = 6
HE_MAX = 1.5
SAFE_ZONE = float.fromhex("0x1.0907dc1930690p-3")  # half-width, sin(15°)/2 ≈ 0.1294; the paper prints 0.1309
ALPHA = float.fromhex("0x1.2b78e1d2c4a8ep-1")  # Eq. (37), ≈ 0.5849
BETA = float.fromhex("0x1.2b78e1d2c4a8ep-2")  # Eq. (38), ≈ 0.2925
KAPPA = float.fromhex("-0x1.460626f4d71b5p-1")  # Eq. (39), ≈ -0.6368


def _table(digits: str) -> tuple[float, ...]:
    return tuple(float.fromhex(x) for x in digits.split())


# For |φ| = 0 … 6. |ρˢ| = sin(π|φ|/12), Eq. (18).
RHO_S = _table(
    "0x0.0p+0 0x1.0907dc1930690p-2 0x1.0000000000000p-1 0x1.6a09e667f3bcdp-1"
    " 0x1.bb67ae8584caap-1 0x1.ee8dd4748bf15p-1 0x1.0000000000000p+0"
)
# |r_opt| = max(|ρˢ|, 2z), Eq. (43).
R_OPT = _table(
    "0x1.0907dc1930690p-2 0x1.0907dc1930690p-2 0x1.0000000000000p-1 0x1.6a09e667f3bcdp-1"
    " 0x1.bb67ae8584caap-1 0x1.ee8dd4748bf15p-1 0x1.0000000000000p+0"
)
# |r_min|, Eqs. (44) to (47). At |φ| = 3, q² is exactly 1/27 and both branches of Eq. (44) give 2/√3.
R_MIN = _table(
    "0x1.0000000000000p+0 0x1.106b6988cb7bap+0 0x1.1d87e8f42a8f6p+0 0x1.279a74590331cp+0"
    " 0x1.2ec0acdc0228ep+0 0x1.330769e0f94dfp+0 0x1.3473de0e4b327p+0"
)
# The exponent (2 - |r_opt|)/(2 - |r_min|), Eq. (42).
OMEGA_EXPONENT = _table(
    "0x1.bdbe08f9b3e5cp+0 0x1.dc4a890abb7d5p+0 0x1.b2128cb7da057p+0 0x1.878de88ba279dp+0"
    " 0x1.6328cbc3e6ffap+0 0x1.4aa0aaf8544d8p+0 0x1.41f8204d60857p+0"
)
# The factor (2 - |r_min|)/(2 - |r_opt|)^exponent of Eq. (41).
OMEGA_FACTOR = _table(
    "0x1.85e4ff3a967a9p-2 0x1.55858bb902dadp-2 0x1.c780459f65e70p-2 0x1.242d0a8d84fa6p-1"
    " 0x1.5f8252c5499a2p-1 0x1.88949f6257153p-1 0x1.971843e3699b2p-1"
)


@compiled
def effective_shift(h: float, p: float) -> float:
    """Effective shift hᵉ.

        hᵉ = max(-1.5, min(1.5, h/20 - p/50 - 1.5))

    Hein et al. 2017, Eq. (8); both variants. Shift h and setpoint p in [0, 100].

    >>> effective_shift(50.0, 50.0), effective_shift(100.0, 0.0)
    (0.0, 1.5)
    """
    return clip(h / 20.0 - p / 50.0 - 1.5, -HE_MAX, HE_MAX)


@compiled
def sgn(x: float) -> int:
    """Sign of x as -1, 0 or 1.

    >>> sgn(-0.3), sgn(0.0), sgn(2.0)
    (-1, 0, 1)
    """
    return int(x > 0.0) - int(x < 0.0)


@compiled
def entered_domain(delta: int, he: float) -> int:
    """Domain δ̂: the sign of hᵉ outside the safe zone, δ inside it.

    Hein et al. 2017, Eq. (9); both variants.

    >>> entered_domain(1, -0.5), entered_domain(-1, 0.1)
    (-1, -1)
    """
    return delta if abs(he) <= SAFE_ZONE else sgn(he)


@compiled
def entered_response(psi: int, delta: int, delta_hat: int) -> int:
    """Response ψ̂: 1 (advantageous) if the domain has just changed, else ψ.

    Hein et al. 2017, Eq. (10); both variants.

    >>> entered_response(-1, 1, -1), entered_response(-1, 1, 1)
    (1, -1)
    """
    return 1 if delta != delta_hat else psi


@compiled
def direction_step(phi: int, delta_hat: int, psi_hat: int, he: float) -> int:
    """Change Δφ of the direction: towards 0 in the safe zone, none at φ = -6 δ̂, else ψ̂ sgn(hᵉ).

    Hein et al. 2017, Eq. (12); both variants.

    >>> direction_step(4, 1, 1, 0.0), direction_step(-6, 1, -1, 0.5), direction_step(4, 1, 1, 0.5)
    (-1, 0, 1)
    """
    if abs(he) <= SAFE_ZONE:
        return -sgn(phi)
    if phi == -PHI_MAX * delta_hat:
        return 0
    return psi_hat * sgn(he)


@compiled
def turned_response(psi_hat: int, phi_hat: int) -> int:
    """Response ψ: -1 (disadvantageous) if |φ̂| is at least 6, else ψ̂.

    Hein et al. 2017, Eq. (13); both variants.

    >>> turned_response(1, 6), turned_response(1, 5)
    (-1, 1)
    """
    return -1 if abs(phi_hat) >= PHI_MAX else psi_hat


@compiled
def reflected_direction(phi_hat: int) -> int:
    """Direction φ in -6 … 6, which is φ̂ reflected at -6 and 6.

        φ = 12 - ((φ̂ + 24) mod 24)   if |φ̂| >= 6;  else φ̂

    Hein et al. 2017, Eq. (14); both variants.

    >>> reflected_direction(6), reflected_direction(7), reflected_direction(-7), reflected_direction(5)
    (6, 5, -5, 5)
    """
    return 12 - ((phi_hat + 24) % 24) if abs(phi_hat) >= PHI_MAX else phi_hat


@compiled
def update_direction(delta: int, psi: int, phi: int, he: float) -> tuple[int, int, int]:
    """Domain δ, response ψ and direction φ of the next step, by Eqs. (9) to (16).

    When φ is 0 in the safe zone, δ and ψ are reset to 1, by Eqs. (15) and (16).

    >>> update_direction(1, 1, 5, 1.0), update_direction(1, -1, 1, 0.0)
    ((1, -1, 6), (1, 1, 0))
    """
    delta_hat = entered_domain(delta, he)
    psi_hat = entered_response(psi, delta, delta_hat)
    phi_hat = phi + direction_step(phi, delta_hat, psi_hat, he)
    psi_next = turned_response(psi_hat, phi_hat)
    phi_next = reflected_direction(phi_hat)
    if phi_next == 0 and abs(he) <= SAFE_ZONE:
        return 1, 1, 0
    return delta_hat, psi_next, phi_next


@compiled
def radius(phi: int, he: float) -> float:
    """Radius ω at which the potential is evaluated; it is ±|r_min| at hᵉ = ±|r_opt|.

        ω = hᵉ |r_min| / |r_opt|                                   if |hᵉ| <= |r_opt|
        ω = sgn(hᵉ) (|r_min| + factor · (|hᵉ| - |r_opt|)^exponent)   else

    Hein et al. 2017, Eqs. (40) to (42); both variants. φ in -6 … 6, hᵉ in [-1.5, 1.5].

    >>> radius(6, 0.5) == 0.5 * R_MIN[6]
    True
    """
    i = abs(phi)
    if abs(he) <= R_OPT[i]:
        return he * R_MIN[i] / R_OPT[i]
    return sgn(he) * (R_MIN[i] + OMEGA_FACTOR[i] * pow(abs(he) - R_OPT[i], OMEGA_EXPONENT[i]))


@compiled
def penalty(phi: int, he: float) -> float:
    """Mis-calibration penalty m(φ, hᵉ), from -1 (best) to about 1.23.

        m = -α ω² + β ω⁴ + κ ρˢ ω,   ρˢ = sin(πφ/12)

    Hein et al. 2017, Eqs. (17) and (18); both variants.

    >>> round(float(penalty(6, 1.0)), 12), round(float(penalty(-6, 1.5)), 4), penalty(2, 0.0)
    (-1.0, 1.2303, 0.0)
    """
    w = radius(phi, he)
    rho_s = sgn(phi) * RHO_S[abs(phi)]
    w2 = w * w
    return -ALPHA * w2 + BETA * (w2 * w2) + KAPPA * rho_s * w
