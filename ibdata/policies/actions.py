"""Actions as they are applied and stored: clipped and rounded, or one of 27 discrete ones."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata._numerics.compiled import compiled

# A discrete action changes velocity, gain and shift by -1, 0 or 1 each, in the order of the class `IBGym` of
# `industrial-benchmark-python` 2.0.
Action = tuple[float, float, float]
CHANGES = (-1.0, 0.0, 1.0)
DISCRETE: tuple[Action, ...] = tuple(product(CHANGES, CHANGES, CHANGES))  # of velocity, gain, shift
WHOLE = f"from 0 to {len(DISCRETE) - 1}"
_TABLE = np.array(DISCRETE, dtype=np.float32)


def is_discrete(numbers: npt.NDArray[Any]) -> bool:
    """Whether an array holds whole numbers (n,), which may be discrete actions."""
    return numbers.ndim == 1 and numbers.dtype.kind in "iu"


def of_discrete(numbers: npt.NDArray[np.integer]) -> npt.NDArray[np.float32] | None:
    """The actions (n, 3) that whole numbers (n,) name; None if one of them names none."""
    inside = bool(((numbers >= 0) & (numbers < len(DISCRETE))).all())
    return _TABLE.take(numbers, axis=0) if inside else None


@compiled
def clipped_and_rounded(x: float) -> np.float32:
    """A component of an action, clipped to [-1, 1] and rounded to float32; -0.0 becomes 0.0, NaN stays."""
    bounded = 1.0 if x > 1.0 else -1.0 if x < -1.0 else x
    return np.float32(bounded) + np.float32(0.0)


@compiled
def clip_and_round(proposed: npt.NDArray[np.float64], out: npt.NDArray[np.float32]) -> int:
    """Write proposed actions (n, 3), clipped to [-1, 1] and rounded to float32, into out (n, 3).

    -0.0 becomes 0.0; NaN stays. Returns the number of rows that were clipped, or -1 - row for the first row
    that is not finite.
    """
    clipped, broken = 0, -1
    for i in range(proposed.shape[0]):
        outside = False
        for j in range(3):
            x = proposed[i, j]
            if broken < 0 and not np.isfinite(x):
                broken = i
            outside = outside or abs(x) > 1.0
            out[i, j] = clipped_and_rounded(x)
        clipped += outside
    return clipped if broken < 0 else -1 - broken


def applied(proposed: npt.ArrayLike) -> npt.NDArray[np.float32]:
    """Return proposed actions (n, 3), clipped to [-1, 1] and rounded to float32."""
    numbers = np.asarray(proposed, dtype=np.float64)
    out = np.empty(numbers.shape, dtype=np.float32)
    clip_and_round(numbers, out)
    return out


def finite_actions(proposed: npt.ArrayLike) -> npt.NDArray[np.float32] | None:
    """Actions (…, 3) that a user gave, clipped and rounded; None if they are not finite real numbers."""
    try:
        numbers = np.asarray(proposed)
        numbers = np.empty(0) if np.iscomplexobj(numbers) else numbers.astype(np.float64)
    except (TypeError, ValueError):
        return None
    if numbers.ndim == 0 or numbers.shape[-1] != 3:
        return None
    out = np.empty(numbers.shape, dtype=np.float32)
    is_finite = clip_and_round(numbers.reshape(-1, 3), out.reshape(-1, 3)) >= 0
    return out if is_finite else None


def read_only(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """The same array, which cannot be changed through it."""
    view = array.view()
    view.flags.writeable = False
    return view
