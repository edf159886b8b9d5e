"""The returns of episodes at each setpoint, by policy. A return is the sum of an episode's rewards."""

import numpy as np
from matplotlib.figure import Figure

from ibdata.plots.spread import QUANTILES, draw_spread
from ibdata.plots.summary import Summary

TITLE = "Returns"


def draw(figure: Figure, summary: Summary) -> None:
    """Draw the spread of the returns, or of the mean rewards if lengths differ."""
    values, label = summary.returns, "return: the sum of an episode's rewards"
    lengths = summary.episodes["length"].to_numpy()
    if np.ptp(lengths) > 0:
        values, label = values / lengths, "mean reward of a step; the episodes differ in length"
    quantiles = np.full((len(summary.setpoints), len(summary.policies), len(QUANTILES)), np.nan)
    for i, j in np.unique([summary.setpoint, summary.policy], axis=1).T:
        chosen = (summary.setpoint == i) & (summary.policy == j)
        quantiles[i, j] = np.quantile(values[chosen], QUANTILES)
    draw_spread(figure, summary, quantiles, f"{label} (minus its costs)", "the episodes")
