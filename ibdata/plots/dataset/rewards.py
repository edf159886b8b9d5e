"""The rewards at each setpoint, by policy: minus the cost, consumption + 3 · fatigue of the next step."""

import numpy as np
from matplotlib.figure import Figure

from ibdata.plots.spread import QUANTILES, draw_spread
from ibdata.plots.summary import Summary

TITLE = "Rewards"
LABEL = "reward of a step: minus the cost, consumption + 3 · fatigue"


def draw(figure: Figure, summary: Summary) -> None:
    """Draw the spread of the rewards."""
    counts = summary.counts
    quantiles = np.full((*counts.rows.shape, len(QUANTILES)), np.nan)
    for i, j in np.argwhere(counts.rows):  # the steps of a bin are spread evenly within it
        below = np.concatenate([[0.0], np.cumsum(counts.rewards[i, j]) / counts.rows[i, j]])
        quantiles[i, j] = np.interp(QUANTILES, below, counts.reward_edges)
    draw_spread(figure, summary, quantiles, LABEL, "the steps")
