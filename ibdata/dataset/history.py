"""Histories of observations, which are built when data are loaded and never stored."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

Array = npt.NDArray[Any]


def stacked(observations: Array, after: Array, step: Array, history: int) -> tuple[Array, Array]:
    """Stack each observation with those before it, newest first.

    The results are copies: views would have negative strides, which PyTorch refuses.

    Args:
        observations: (N, k), of whole episodes in order; k is 6 unless a view shows other frames.
        after: The next observations (N, k).
        step: The step of each row within its episode (N,).
        history: How many observations to stack. Before the start of an episode, its first one is repeated.

    Returns:
        The histories of the observations and of the next observations, both (N, k · history).

    >>> o = np.array([[1.0], [2.0], [5.0]]); n = np.array([[2.0], [3.0], [6.0]])
    >>> now, later = stacked(o, n, np.array([0, 1, 0]), 2)
    >>> now.tolist(), later.tolist()
    ([[1.0, 1.0], [2.0, 1.0], [5.0, 5.0]], [[2.0, 1.0], [3.0, 2.0], [6.0, 5.0]])
    """
    if history == 1:
        return observations, after
    starts = np.flatnonzero(step == 0)
    width = history * observations.shape[1]
    now, later = (np.empty((len(step), width), dtype=observations.dtype) for _ in range(2))
    for start, stop in pairwise([*starts.tolist(), len(step)]):
        windows = _windows(observations[start:stop], after[stop - 1], history)
        now[start:stop], later[start:stop] = windows[:-1], windows[1:]
    return now, later


def _windows(observations: Array, last: Array, history: int) -> Array:
    """The histories (steps + 1, k · history) of an episode's observations and of its last next observation.

    The frames are reversed in memory, so that each window begins with its newest frame.
    """
    frames = np.concatenate(
        [last[None], observations[::-1], np.repeat(observations[:1], history - 1, axis=0)]
    )
    windows = sliding_window_view(frames.reshape(-1), history * frames.shape[1])[:: frames.shape[1]]
    return windows[::-1]
