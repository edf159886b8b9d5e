"""Consumption (operational cost, mis-calibration and noise) and reward."""

from __future__ import annotations

from ibdata.numerics.compiled import compiled

PENALTY_WEIGHT = 25.0
FATIGUE_WEIGHT = 3.0


@compiled
def expected_consumption(theta_c: float, m: float, offset: float) -> float:
    """Noise-free consumption ĉ.

        ĉ = θᶜ + 25 (m + offset)

    Hein et al. 2017, Eq. (19) with offset 0; IDS.py, updateOperationalCosts, with offset 1.

    >>> expected_consumption(70.0, -0.5, 1.0)
    82.5
    """
    return theta_c + PENALTY_WEIGHT * (m + offset)


@compiled
def consumption(c_hat: float, z: float, k: float) -> float:
    """Observed consumption c, with z ~ N(0, 1).

        c = ĉ + (1 + k ĉ) z

    Hein et al. 2017, Eq. (20); k is a field of the variant.

    >>> consumption(100.0, -1.0, 0.02)
    97.0
    """
    return c_hat + (1.0 + k * c_hat) * z


@compiled
def reward(c: float, f: float) -> float:
    """Reward of a state with consumption c and fatigue f.

        r = -c - 3 f

    Hein et al. 2017, Eq. (5); both variants.

    >>> reward(100.0, 20.0)
    -160.0
    """
    return -c - FATIGUE_WEIGHT * f
