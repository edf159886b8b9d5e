"""Clip and round actions to the values that are applied and stored."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ibdata.numerics.compiled import compiled


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
    given = np.asarray(proposed, dtype=np.float64)
    out = np.empty(given.shape, dtype=np.float32)
    clip_and_round(given, out)
    return out
