"""Histories of observations, built when loading and never stored."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


def stacked(observations: Array, after: Array, step: Array, history: int) -> tuple[Array, Array]:
    """Histories (N, 6 · history) of observations and of next observations, both (N, 6), newest first.

    step (N,) is each row's step within its episode; at the start the first observation is repeated.

    >>> o = np.array([[1.0], [2.0], [5.0]]); n = np.array([[2.0], [3.0], [6.0]])
    >>> now, later = stacked(o, n, np.array([0, 1, 0]), 2)
    >>> now.tolist(), later.tolist()
    ([[1.0, 1.0], [2.0, 1.0], [5.0, 5.0]], [[2.0, 1.0], [3.0, 2.0], [6.0, 5.0]])
    """
    if history == 1:
        return observations, after
    rows = np.arange(len(step))
    first = rows - step
    now = np.stack([observations[np.maximum(rows - lag, first)] for lag in range(history)], axis=1)
    later = np.concatenate([after[:, None], now[:, :-1]], axis=1)
    return now.reshape(len(step), -1), later.reshape(len(step), -1)
