"""The rewards at each setpoint, by policy: minus the cost, consumption + 3 · fatigue of the next step."""

import numpy as np
from matplotlib.figure import Figure

from ibdata.plots.spread import QUANTILES, draw_spread
from ibdata.plots.style import Floats, Numbers
from ibdata.plots.summary import Summary

TITLE = "Rewards"
LABEL = "reward of a step: minus the cost, consumption + 3 · fatigue"


def draw(figure: Figure, summary: Summary) -> None:
    """Draw the spread of the rewards."""
    counts = summary.counts
    quantiles = np.array(
        [[_quantiles(histogram, counts.reward_edges) for histogram in row] for row in counts.rewards]
    )
    draw_spread(figure, summary, quantiles, LABEL, "the steps")


def _quantiles(counts: Numbers, edges: Floats) -> Floats:
    """Quantiles of a histogram, whose steps are spread evenly within a bin."""
    total = counts.sum()
    if total == 0:
        return np.full(len(QUANTILES), np.nan)
    below = np.concatenate([[0.0], np.cumsum(counts) / total])
    return np.interp(QUANTILES, below, edges)
