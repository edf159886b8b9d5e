"""How often each pair of velocity, gain and shift was visited under each policy."""

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from ibdata.plots.counts import PAIRS, STEERINGS
from ibdata.plots.style import WIDTH, count_bar, counted
from ibdata.plots.summary import Summary

TITLE = "Coverage"


def draw(figure: Figure, summary: Summary) -> None:
    """Draw a row of panels for each policy, and in it a panel for each pair."""
    figure.set_size_inches(WIDTH, 1.3 + 1.5 * len(summary.policies))
    counts = summary.counts.coverage
    norm = LogNorm(1, max(10, counts.max()))
    panels = figure.subplots(len(counts), len(PAIRS), sharex=True, sharey=True, squeeze=False)
    for row, pictures, name in zip(panels, counts, summary.policies, strict=True):
        for axes, (_, b), visits in zip(row, PAIRS, pictures, strict=True):
            shown = counted(axes, visits, (0.0, 100.0, 0.0, 100.0), norm)
            axes.set_aspect("equal")
            axes.set_ylabel(summary.label(STEERINGS[b]), labelpad=1)
            axes.set_title(f"{np.count_nonzero(visits) / visits.size:.1%}", loc="right", size=8)
        row[0].set_title(f"{name}\n", loc="left")
    for axes, (a, _) in zip(panels[-1], PAIRS, strict=True):
        axes.set_xlabel(summary.label(STEERINGS[a]))
    count_bar(figure, shown, figure.axes, location="bottom", shrink=0.6, aspect=40)
    figure.suptitle(f"%: share of the {visits.size:,} squares that were visited; the others are white")
