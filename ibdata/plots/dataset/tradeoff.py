"""Fatigue against consumption, the two parts of the reward."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from ibdata.plots.counts import COSTS
from ibdata.plots.style import SERIES, count_bar, counted
from ibdata.plots.summary import Summary

TITLE = "Fatigue against consumption"
LINES = 4  # lines of equal reward


def size(summary: Summary) -> tuple[float, float]:
    """(width, height) in inches."""
    return 4.8, 4.8


def draw(figure: Figure, summary: Summary) -> None:
    """Draw all steps in grey, means of setpoints in the policies' colours, and lines of equal reward."""
    counts, episodes = summary.counts, summary.episodes
    x, y = counts.cost_edges
    axes = figure.subplots()
    norm = LogNorm(1, max(2, counts.costs.max()))
    shown = counted(axes, counts.costs, (x[0], x[-1], y[0], y[-1]), norm, "Greys")
    for j, (name, (color, marker, line)) in enumerate(zip(episodes.policies, SERIES, strict=False)):
        means = counts.mean_costs[:, j]
        there = np.flatnonzero(np.isfinite(means[:, 0]))
        axes.plot(*means[there].T, marker, linestyle=line, color=color, markeredgecolor="white",
                  markersize=5, linewidth=1.0, label=name)  # fmt: skip
        for i in {there[0], there[-1]}:
            axes.annotate(episodes.setpoints[i], means[i], (4, 3), textcoords="offset points", fontsize=7)
    for total in np.linspace(x[0] + 3 * y[0], x[-1] + 3 * y[-1], LINES + 2)[1:-1]:
        axes.axline((total, 0.0), (total - 3.0, 1.0), color="0.4", linewidth=0.6, linestyle=":")
    axes.set_xlim(x[0], x[-1])
    axes.set_ylim(y[0], y[-1])
    axes.set_xlabel(summary.label(COSTS[0]))
    axes.set_ylabel(summary.label(COSTS[1]))
    count_bar(figure, shown, axes, orientation="horizontal", shrink=0.7)
    figure.legend(
        loc="outside upper left",
        ncols=3,
        title="means of setpoints, the first and last named; dotted: equal reward",
    )
