"""The moving setpoint: piecewise linear, with drawn lengths and rates."""

from __future__ import annotations

import math

from ibdata.dynamics.steering import clip
from ibdata.dynamics.variants import Parameters
from ibdata.numerics.compiled import compiled

NO_DRIFT = -1  # steps left of a segment, for a setpoint that stays where it is
ZERO_RATE = 0.1  # weight of the delta distribution at b = 0


@compiled
def segment_length(u: float, longest: float) -> int:
    """Steps l of a new segment, uniform on 1 … longest: l = 1 + ⌊longest · u⌋, u ~ U(0, 1).

    Hein et al. 2017, section "Setpoint dynamics"; the longest length is a field of the variant.

    >>> segment_length(0.001, 100.0), segment_length(0.999, 100.0)
    (1, 100)
    """
    return 1 + math.floor(longest * u)


@compiled
def segment_rate(u: float, u_zero: float, low: float, high: float) -> float:
    """Change b of the setpoint per step in a new segment: U(low, high) with weight 0.9, else 0.

    Hein et al. 2017, section "Setpoint dynamics"; the range is a field of the variant.

    >>> segment_rate(0.75, 0.5, -1.0, 1.0), segment_rate(0.75, 0.05, -1.0, 1.0)
    (0.5, 0.0)
    """
    if u_zero < ZERO_RATE:
        return 0.0
    return low + (high - low) * u


@compiled
def turned_at_bound(b: float, p: float, u: float, flip: float) -> float:
    """The rate b, its sign changed with probability `flip` where the setpoint p stands at a bound.

        b_{t+1} = -b_t  if (p_t = 0 or p_t = 100) and z < ½;  else b_t

    Hein et al. 2017, Eq. (33): before the setpoint moves. u = z ~ U(0, 1).

    >>> turned_at_bound(0.5, 100.0, 0.4, 0.5), turned_at_bound(0.5, 99.0, 0.4, 0.5)
    (-0.5, 0.5)
    """
    return -b if (p == 0.0 or p == 100.0) and u < flip else b


@compiled
def turned_past_bound(b: float, p: float, u: float, flip: float) -> float:
    """The rate b, its sign changed with probability `flip` where p + b leaves [0, 100].

    IDS.py, updateSetPoint: the step is still made with the old sign and clipped; the new one is for the
    next step. u ~ U(0, 1).

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

    A segment is drawn where none is left, is used in the same step, and may turn in it.

    >>> from ibdata.dynamics import PAPER, SIEMENS
    >>> drift(99.5, 1.0, 2, 0.5, 0.5, 0.5, 0.4, SIEMENS.parameters())
    (100.0, -1.0, 1)
    >>> drift(100.0, 1.0, 2, 0.5, 0.5, 0.5, 0.4, PAPER.parameters())
    (99.0, -1.0, 1)
    """
    if left == 0:
        left = segment_length(u_length, k.drift_length)
        b = segment_rate(u_rate, u_zero, k.drift_rate_low, k.drift_rate_high)
    b = turned_at_bound(b, p, u_flip, k.flip_before)
    return moved(p, b), turned_past_bound(b, p, u_flip, k.flip_after), left - 1
