"""The latest frames of n lanes while episodes are simulated, newest first."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ibdata.views.imperfections import Measurement
from ibdata.views.options import ACTIONS, ViewOptions

Float32s = npt.NDArray[np.float32]
Indices = npt.NDArray[np.int64]


class Window:
    """The last `history` frames of n lanes through a view. At first, the first frame is repeated."""

    def __init__(self, options: ViewOptions, drifting: bool, n: int, history: int) -> None:
        columns = options.columns(drifting)
        self._measurement = Measurement(options.imperfections, columns)
        self._flagged = [columns.index(name) for name in options.flagged(drifting)]
        self._actions = options.actions
        self._numbers, self._times = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
        max_delay = int(self._measurement.delay.max())
        self._clean = np.zeros((n, max_delay + 1, len(columns)), dtype=np.float32)  # newest first
        self._arrived = np.zeros((n, len(columns)), dtype=np.float32)
        self.frames = np.zeros((n, history, len(options.frame(drifting))), dtype=np.float32)

    def begin(self, lanes: Indices, clean: Float32s, numbers: Indices) -> None:
        """Begin episodes with these numbers (k,) and true values `clean` (k, columns) in some lanes."""
        self._numbers[lanes], self._times[lanes] = numbers, 0
        self._clean[lanes] = clean[:, None]
        actions = np.zeros((len(lanes), len(ACTIONS)), dtype=np.float32)
        self.frames[lanes] = self._frame(lanes, actions)[:, None]

    def push(self, lanes: Indices, clean: Float32s, actions: Float32s) -> None:
        """Add the frame of some lanes after a step with the actions (k, 3)."""
        self._times[lanes] += 1
        self._clean[lanes, 1:] = self._clean[lanes, :-1]
        self._clean[lanes, 0] = clean
        self.frames[lanes, 1:] = self.frames[lanes, :-1]
        self.frames[lanes, 0] = self._frame(lanes, actions)

    def _frame(self, lanes: Indices, actions: Float32s) -> Float32s:
        """The newest frame of some lanes."""
        delay = self._measurement.delay
        delayed = self._clean[lanes[:, None], delay, np.arange(len(delay))]
        lost = np.zeros(delayed.shape, dtype=bool)
        arrived = delayed
        for time in np.unique(self._times[lanes]).tolist():  # lanes at one time are measured together
            rows = np.flatnonzero(self._times[lanes] == time)
            numbers = self._numbers[lanes[rows]]
            arrived[rows], lost[rows] = self._measurement.step(delayed[rows], numbers, time)
        self._arrived[lanes] = np.where(lost, self._arrived[lanes], arrived)
        parts = [self._arrived[lanes], lost[:, self._flagged], actions[:, : len(ACTIONS) * self._actions]]
        return np.concatenate(parts, axis=1, dtype=np.float32)
