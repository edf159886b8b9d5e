"""The stochasticity of actions: of a fitted behaviour model, and of the recorded densities."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ibdata.measures.coverage import STATES

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

LEAST_ROWS = 10  # of a cell; the standard deviation of fewer is too small on average


class Stochasticity:
    """Estimated action stochasticity EAS, collected from batches of rows.

        EAS = mean over the rows of σ(s), where π(a | s) = N(μ(s), σ(s)) is fitted by maximum likelihood

    After Swazinna, Udluft and Runkler 2021 (arXiv 2111.13461), whose μ and σ are networks. Here both are
    constant in each cell of the grid of states, so that the fit is exact: the mean and the standard deviation
    of the actions in the cell. Cells with fewer than 10 rows do not count.
    """

    def __init__(self) -> None:
        self._rows = np.zeros(STATES)
        self._sums, self._squares = np.zeros((2, 3, STATES))

    def add(self, states: Ints, actions: Floats) -> None:
        """Add rows: the numbers of their states (n,) and their actions (n, 3)."""
        self._rows += np.bincount(states, minlength=STATES)
        for i in range(3):
            self._sums[i] += np.bincount(states, actions[:, i], STATES)
            self._squares[i] += np.bincount(states, actions[:, i] ** 2, STATES)

    @property
    def value(self) -> float | None:
        """The mean over rows and the three actions; None if no cell has enough rows."""
        enough = self._rows >= LEAST_ROWS
        if not enough.any():
            return None
        rows = self._rows[enough]
        variance = (self._squares[:, enough] - self._sums[:, enough] ** 2 / rows) / (rows - 1.0)
        return float(np.average(np.sqrt(np.maximum(variance, 0.0)).mean(axis=0), weights=rows))


def action_entropy(log_prob: Floats) -> float:
    """The entropy of the behaviour, estimated from the recorded densities: -mean log π(a | s).

    A deterministic policy has 0, and uniform random actions have 3 log 2 = 2.08: densities are relative to
    lengths and to unit masses. It is NaN if a density is not known.

    >>> round(action_entropy(np.log([0.5, 0.125])), 6)  # (log 2 + log 8) / 2 = 2 log 2
    1.386294
    """
    return float(-log_prob.mean(dtype=np.float64))
