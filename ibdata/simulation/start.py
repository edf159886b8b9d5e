"""The start of an episode, computed from uniform draws."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
# "default": velocity, gain and shift 50 each; "uniform" on [0, 100]; or the fewest and the most random steps.
Start = str | tuple[int, int]


def steerings(start: Start, u: Floats) -> tuple[Floats, Floats, Floats]:
    """Velocity, gain and shift (n,) of a start, from u (n, 3): 100 u if uniform, else 50 each.

    >>> [x.tolist() for x in steerings("uniform", np.array([[0.25, 0.5, 0.75]]))]
    [[25.0], [50.0], [75.0]]
    """
    v, g, h = (100.0 * u if start == "uniform" else np.full(u.shape, 50.0)).T
    return v, g, h


def burn_in_steps(fewest: int, most: int, u: Floats) -> npt.NDArray[np.int64]:
    """Numbers of steps (n,) of the burn-in, uniform on fewest … most, from the first column of u (n, 3).

    >>> burn_in_steps(15, 64, np.array([[0.0, 0, 0], [0.999, 0, 0]])).tolist()
    [15, 64]
    """
    return fewest + np.floor((most - fewest + 1) * u[:, 0]).astype(np.int64)
