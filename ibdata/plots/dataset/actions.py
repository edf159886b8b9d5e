"""The actions of each policy. Spikes are actions that the policy takes again and again."""

import numpy as np
from matplotlib.figure import Figure

from ibdata.plots.counts import ACTION_EDGES
from ibdata.plots.style import SERIES, WIDTH
from ibdata.plots.summary import Summary
from ibdata.views.options import ACTIONS

TITLE = "Actions"
UNIFORM = 0.5  # the density of uniform actions


def draw(figure: Figure, summary: Summary) -> None:
    """Draw a row of panels for each policy, and in it a panel for each number of the action: densities."""
    figure.set_size_inches(WIDTH, 1.0 + 1.2 * len(summary.policies))
    panels = figure.subplots(len(summary.policies), len(ACTIONS), sharex=True, squeeze=False)
    everything = zip(panels, summary.counts.actions, summary.policies, SERIES, strict=False)
    for row, counts, name, (color, *_) in everything:
        for axes, count in zip(row, counts, strict=True):
            density = count / max(1, count.sum()) / np.diff(ACTION_EDGES)
            axes.stairs(density, ACTION_EDGES, fill=True, color=color)
            axes.axhline(UNIFORM, color="0.3", linewidth=0.8, linestyle=":")
            axes.set_ylim(0, max(0.7, 1.05 * density.max()))
            axes.set_xlim(-1.05, 1.05)
            axes.locator_params(axis="y", nbins=4)
            axes.set_xticks([-1, 0, 1])
        row[0].set_title(name, loc="left")
    for axes, column in zip(panels[-1], ACTIONS, strict=True):
        axes.set_xlabel(column.removeprefix("act_"))
    figure.supylabel("density", size=9)
    figure.suptitle(
        f"proposed changes at t; each panel has its own scale\ndotted: {UNIFORM}, uniform actions"
    )
