"""The rewards at each setpoint, by policy: minus the cost, consumption + 3 · fatigue of the next step."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ibdata.plots import spread
from ibdata.plots.groups import Floats
from ibdata.plots.summary import Summary

TITLE = "Rewards"
LABEL = "reward of a step: minus the cost, consumption + 3 · fatigue"
size = spread.size


def draw(figure: Figure, summary: Summary) -> None:
    """Draw the spread of the rewards."""
    counts = summary.counts
    found = np.array([[_quantiles(own, counts.reward_edges) for own in row] for row in counts.rewards])
    spread.draw(figure, summary, found, LABEL, "the steps")


def _quantiles(counts: Floats, edges: Floats) -> Floats:
    """Quantiles of a histogram, whose steps are spread evenly within a bin."""
    total = counts.sum()
    if total == 0:
        return np.full(len(spread.QUANTILES), np.nan)
    below = np.concatenate([[0.0], np.cumsum(counts) / total])
    return np.interp(spread.QUANTILES, below, edges)
