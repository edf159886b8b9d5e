"""The frames that are seen while episodes are simulated: the last ones of n lanes, newest first."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ibdata.views.options import ACTIONS, ViewOptions

Float32s = npt.NDArray[np.float32]
Indices = npt.NDArray[np.int64]


class Window:
    """What n lanes see of their episodes through a view: `history` frames each, the first one repeated."""

    def __init__(self, options: ViewOptions, drifting: bool, n: int, history: int) -> None:
        columns = options.columns(drifting)
        self._measurement = options.imperfections.of(columns)
        self._flagged = [columns.index(name) for name in options.flagged(drifting)]
        self._actions = options.actions
        self._numbers, self._times = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
        most = int(self._measurement.delay.max())
        self._clean = np.zeros((n, most + 1, len(columns)), dtype=np.float32)  # newest first
        self._arrived = np.zeros((n, len(columns)), dtype=np.float32)
        self.frames = np.zeros((n, history, len(options.frame(drifting))), dtype=np.float32)

    def begin(self, which: Indices, clean: Float32s, numbers: Indices) -> None:
        """Begin episodes with these numbers (k,) in some lanes, whose true values are clean (k, columns)."""
        self._numbers[which], self._times[which] = numbers, 0
        self._clean[which] = clean[:, None]
        actions = np.zeros((len(which), len(ACTIONS)), dtype=np.float32)
        self.frames[which] = self._frame(which, actions)[:, None]

    def push(self, which: Indices, clean: Float32s, actions: Float32s) -> None:
        """Add the frame after a step of some lanes, to which the actions (k, 3) led."""
        self._times[which] += 1
        self._clean[which, 1:] = self._clean[which, :-1]
        self._clean[which, 0] = clean
        self.frames[which, 1:] = self.frames[which, :-1]
        self.frames[which, 0] = self._frame(which, actions)

    def _frame(self, which: Indices, actions: Float32s) -> Float32s:
        """The newest frame of some lanes."""
        delay = self._measurement.delay
        late = self._clean[which[:, None], delay, np.arange(len(delay))]
        lost = np.zeros(late.shape, dtype=bool)
        arrived = late
        for time in np.unique(self._times[which]).tolist():  # lanes at one time are measured together
            own = np.flatnonzero(self._times[which] == time)
            arrived[own], lost[own] = self._measurement.step(late[own], self._numbers[which[own]], time)
        self._arrived[which] = np.where(lost, self._arrived[which], arrived)
        parts = [self._arrived[which], lost[:, self._flagged], actions[:, : len(ACTIONS) * self._actions]]
        return np.concatenate(parts, axis=1, dtype=np.float32)
