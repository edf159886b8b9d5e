"""Steering: the effect of an action on velocity, gain and shift."""

from __future__ import annotations

from ibdata.numerics.compiled import compiled

D_V = 1.0
D_G = 10.0
D_H = float.fromhex("0x1.7019237851756p+2")  # 20 sin(15°) / 0.9 ≈ 5.7515, rounded as in IDS.py


@compiled
def clip(x: float, low: float, high: float) -> float:
    """max(low, min(high, x)).

    >>> clip(7.0, -1.0, 1.0)
    1.0
    """
    return max(low, min(high, x))


@compiled
def steer(x: float, d: float, delta: float) -> float:
    """Velocity v, gain g or shift h after a proposed change Δx.

        x_{t+1} = max(0, min(100, x_t + d Δx_t))

    Hein et al. 2017, Eqs. (2), (3), (4), where (4) prints Δs for Δh; both variants. The step size d is
    `D_V`, `D_G` or `D_H`; Δx is clipped to [-1, 1] as the authors' code does; x in [0, 100].

    >>> steer(99.5, D_V, 1.0), steer(50.0, D_G, -7.0)
    (100.0, 40.0)
    """
    return clip(x + d * clip(delta, -1.0, 1.0), 0.0, 100.0)
