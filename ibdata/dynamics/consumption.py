"""Operational cost, consumption and reward."""

from __future__ import annotations

from ibdata._numerics.arrays import Floats
from ibdata._numerics.compiled import compiled
from ibdata._numerics.exact import exp

Weights = tuple[float, float, float, float, float]

PENALTY_WEIGHT = 25.0
FATIGUE_WEIGHT = 3.0


@compiled
def operational_cost(p: float, v: float, g: float) -> float:
    """Operational cost θ of the current setpoint p, velocity v and gain g.

        θ = exp((2 p + 4 v + 2.5 g) / 100)

    Hein et al. 2017, Eq. (6); both variants. p, v, g in [0, 100]; θ in [1, e^8.5 ≈ 4914.8].

    >>> round(float(operational_cost(50.0, 50.0, 50.0)), 3)
    70.105
    """
    return exp((2.0 * p + 4.0 * v + 2.5 * g) / 100.0)


@compiled
def remember(theta: Floats, history: Floats) -> None:
    """Shift the costs θ (n,) of n lanes into their history (10, n), newest first, in place.

    Before the first step the history is all zeros, which no θ can be. The first θ then fills it, as in the
    constructor of the authors' `IDS`; the paper does not specify this.

    >>> import numpy as np
    >>> history = np.zeros((10, 1))
    >>> remember(np.array([2.0]), history); remember(np.array([3.0]), history); history[:3, 0].tolist()
    [3.0, 2.0, 2.0]
    """
    for lag in range(9, 0, -1):
        for i in range(theta.shape[0]):
            history[lag, i] = theta[i] if history[0, i] == 0.0 else history[lag - 1, i]
    for i in range(theta.shape[0]):
        history[0, i] = theta[i]


@compiled
def convolved_cost(theta: Floats, i: int, w: Weights) -> float:
    """Convolved operational cost θᶜ of lane i of a history (10, n), θ[t] … θ[t-9], newest first.

        θᶜ_t = w₅ θ_{t-5} + w₆ θ_{t-6} + w₇ θ_{t-7} + w₈ θ_{t-8} + w₉ θ_{t-9}

    Hein et al. 2017, Eq. (7); the weights (1, 2, 3, 2, 1)/9 are a field of the variant.

    >>> import numpy as np
    >>> convolved_cost(np.arange(10.0).reshape(10, 1), 0, (0.0, 0.0, 0.0, 0.25, 0.5))
    6.5
    """
    w5, w6, w7, w8, w9 = w
    theta_c: float = w5 * theta[5, i] + w6 * theta[6, i] + w7 * theta[7, i] + w8 * theta[8, i]
    theta_c += w9 * theta[9, i]
    return theta_c


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
