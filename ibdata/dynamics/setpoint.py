"""What moves: the setpoint along segments of random length and rate, and the steerings by actions."""

from __future__ import annotations

import math

from ibdata._numerics.compiled import compiled
from ibdata._numerics.exact import clip
from ibdata.dynamics.variants import Parameters

ZERO_RATE = 0.1  # probability of the rate b = 0
D_V = 1.0
D_G = 10.0
D_H = float.fromhex("0x1.7019237851756p+2")  # 20 sin(15°) / 0.9 ≈ 5.7515, rounded as in IDS.py


@compiled
def segment_length(u: float, longest: float) -> int:
    """Length l of a new segment in steps, uniform on 1 … longest.

        l = 1 + ⌊longest · u⌋

    Hein et al. 2017, section "Setpoint dynamics"; `longest` is a field of the variant. u ~ U(0, 1).

    >>> segment_length(0.001, 100.0), segment_length(0.999, 100.0)
    (1, 100)
    """
    return 1 + math.floor(longest * u)


@compiled
def segment_rate(u: float, u_zero: float, low: float, high: float) -> float:
    """Rate b of a new segment, the change per step: from U(low, high) with probability 0.9, else 0.

    Hein et al. 2017, section "Setpoint dynamics"; the range is a field of the variant.

    >>> segment_rate(0.75, 0.5, -1.0, 1.0), segment_rate(0.75, 0.05, -1.0, 1.0)
    (0.5, 0.0)
    """
    if u_zero < ZERO_RATE:
        return 0.0
    return low + (high - low) * u


@compiled
def turned_at_bound(b: float, p: float, u: float, flip: float) -> float:
    """Rate b, with its sign changed with probability `flip` if the setpoint p is at a bound.

        b_{t+1} = -b_t  if (p_t = 0 or p_t = 100) and z < ½;  else b_t

    Hein et al. 2017, Eq. (33), applied before the setpoint moves, with flip = ½ and u = z ~ U(0, 1).

    >>> turned_at_bound(0.5, 100.0, 0.4, 0.5), turned_at_bound(0.5, 99.0, 0.4, 0.5)
    (-0.5, 0.5)
    """
    return -b if (p == 0.0 or p == 100.0) and u < flip else b


@compiled
def turned_past_bound(b: float, p: float, u: float, flip: float) -> float:
    """Rate b, with its sign changed with probability `flip` if p + b is outside [0, 100].

    IDS.py, updateSetPoint: the current step uses the old sign and is clipped, the next step uses the new
    sign. u ~ U(0, 1).

    >>> turned_past_bound(0.5, 99.8, 0.4, 0.5), turned_past_bound(0.5, 99.8, 0.6, 0.5)
    (-0.5, 0.5)
    """
    return -b if (p + b > 100.0 or p + b < 0.0) and u < flip else b


@compiled
def moved(p: float, b: float) -> float:
    """The setpoint after one step at rate b.

        p_{t+1} = max(0, min(100, p_t + b_{t+1}))

    Hein et al. 2017, Eq. (32); both variants.

    >>> moved(99.5, 0.75)
    100.0
    """
    return clip(p + b, 0.0, 100.0)


@compiled
def drift(
    p: float,
    b: float,
    left: int,
    u_length: float,
    u_rate: float,
    u_zero: float,
    u_flip: float,
    k: Parameters,
) -> tuple[float, float, int]:
    """Setpoint p, rate b and steps left of the segment after one step.

    If no steps are left, a new segment is drawn. It takes effect in the same step, and may turn in it.

    >>> from ibdata.dynamics import PAPER, SIEMENS
    >>> drift(99.5, 1.0, 2, 0.5, 0.5, 0.5, 0.4, SIEMENS.parameters)
    (100.0, -1.0, 1)
    >>> drift(100.0, 1.0, 2, 0.5, 0.5, 0.5, 0.4, PAPER.parameters)
    (99.0, -1.0, 1)
    """
    if left == 0:
        left = segment_length(u_length, k.drift_length)
        b = segment_rate(u_rate, u_zero, *k.drift_rate)
    flip_before, flip_after = k.drift_flip
    b = turned_at_bound(b, p, u_flip, flip_before)
    return moved(p, b), turned_past_bound(b, p, u_flip, flip_after), left - 1


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
