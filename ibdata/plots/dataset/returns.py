"""The returns of episodes at each setpoint, by policy. A return is the sum of an episode's rewards."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter

from ibdata.plots.groups import Floats
from ibdata.plots.style import SERIES, legend_above
from ibdata.plots.summary import Summary

TITLE = "Returns"
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


def size(summary: Summary) -> tuple[float, float]:
    """(width, height) in inches."""
    rows = len(summary.episodes.setpoints) * max(2, len(summary.episodes.policies))
    return 4.8, 2.0 + 0.14 * rows


def values(summary: Summary) -> tuple[Floats, str]:
    """The value of each episode and its label: the return, or the mean reward if lengths differ."""
    episodes = summary.episodes
    if (episodes.length == episodes.length[0]).all():
        return episodes.returns, "return: sum of an episode's rewards (cost)"
    return episodes.returns / episodes.length, "mean reward of a step; the episodes differ in length (cost)"


def draw(figure: Figure, summary: Summary) -> None:
    """Draw a line from 5 to 95 %, a thick line between the quartiles, and a mark at the median."""
    episodes = summary.episodes
    drawn, label = values(summary)
    axes = figure.subplots()
    for j, (name, (color, marker, _)) in enumerate(zip(episodes.policies, SERIES, strict=False)):
        places, found = [], []
        for i in range(len(episodes.setpoints)):
            own = drawn[(episodes.setpoint == i) & (episodes.policy == j)]
            if len(own):
                places.append(i + 0.8 * ((j + 0.5) / len(episodes.policies) - 0.5))
                found.append(np.quantile(own, QUANTILES))
        low, lower, median, upper, high = np.transpose(found)
        axes.hlines(places, low, high, color=color, linewidth=0.8)
        axes.hlines(places, lower, upper, color=color, linewidth=2.5)
        axes.plot(median, places, marker, color=color, markersize=4.5, markeredgewidth=0, label=name)
    axes.set_yticks(range(len(episodes.setpoints)), episodes.setpoints)
    axes.set_ylim(-0.5, len(episodes.setpoints) - 0.5)
    axes.set_ylabel(summary.setpoint_label)
    axes.set_xlabel(label)
    axes.grid(axis="x", color="0.9")
    axes.locator_params(axis="x", nbins=5)
    axes.xaxis.set_major_formatter(EngFormatter(sep=""))
    legend_above(axes)
    figure.suptitle("mark: median; thick line: quartiles; thin line: 5 to 95 % of the episodes")
