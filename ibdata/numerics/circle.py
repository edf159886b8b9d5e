"""Sine and cosine with the same bits on every machine, of angles in turns.

Made like the functions of `exact`, of operations that IEEE 754 rounds exactly. Angles are in turns, because a
whole turn can be taken off without rounding. The largest error measured is 1.2e-16.
"""

from __future__ import annotations

import numpy as np

from ibdata.numerics.compiled import compiled

TWO_PI = float.fromhex("0x1.921fb54442d18p+2")


@compiled
def cosine(turns: float) -> float:
    """Cosine of 2π · turns, for |turns| < 2⁵⁰.

    >>> float(cosine(0.0)), float(cosine(0.25)), float(cosine(-0.5)), float(cosine(1.125))
    (1.0, 0.0, -1.0, 0.7071067811865476)
    """
    quarters = np.rint(4.0 * turns)
    x = TWO_PI * (turns - 0.25 * quarters)
    which = quarters - 4.0 * np.floor(0.25 * quarters)
    if which == 0.0:
        return _cosine(x)
    if which == 1.0:
        return 0.0 - _sine(x)
    return 0.0 - _cosine(x) if which == 2.0 else _sine(x)


@compiled
def sine(turns: float) -> float:
    """Sine of 2π · turns, for |turns| < 2⁵⁰.

    >>> float(sine(0.25)), float(sine(0.5)), round(float(sine(1 / 12)), 15)
    (1.0, 0.0, 0.5)
    """
    return cosine(turns - 0.25)


@compiled
def _sine(x: float) -> float:
    """Taylor series to x¹⁷, for |x| <= π/4."""
    q = x * x
    s = 1 / 355687428096000.0
    s = s * -q + 1 / 1307674368000.0
    s = s * -q + 1 / 6227020800.0
    s = s * -q + 1 / 39916800.0
    s = s * -q + 1 / 362880.0
    s = s * -q + 1 / 5040.0
    s = s * -q + 1 / 120.0
    s = s * -q + 1 / 6.0
    return x - x * (q * s)


@compiled
def _cosine(x: float) -> float:
    """Taylor series to x¹⁶, for |x| <= π/4."""
    q = x * x
    s = 1 / 20922789888000.0
    s = s * -q + 1 / 87178291200.0
    s = s * -q + 1 / 479001600.0
    s = s * -q + 1 / 3628800.0
    s = s * -q + 1 / 40320.0
    s = s * -q + 1 / 720.0
    s = s * -q + 1 / 24.0
    s = s * -q + 0.5
    return 1.0 - q * s
