"""The returns of episodes at each setpoint, by policy. A return is the sum of an episode's rewards."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ibdata.plots import spread
from ibdata.plots.spread import QUANTILES
from ibdata.plots.summary import Summary

TITLE = "Returns"
size = spread.size


def draw(figure: Figure, summary: Summary) -> None:
    """Draw the spread of the returns, or of the mean rewards if lengths differ."""
    episodes = summary.episodes
    values, label = episodes.returns, "return: the sum of an episode's rewards"
    if np.ptp(episodes.length) > 0:
        values, label = values / episodes.length, "mean reward of a step; the episodes differ in length"
    found = np.full((len(episodes.setpoints), len(episodes.policies), len(QUANTILES)), np.nan)
    for i, j in np.unique([episodes.setpoint, episodes.policy], axis=1).T:
        own = (episodes.setpoint == i) & (episodes.policy == j)
        found[i, j] = np.quantile(values[own], QUANTILES)
    spread.draw(figure, summary, found, f"{label} (minus its costs)", "the episodes")
