"""Coverage: how often each pair of velocity, gain and shift was visited."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from ibdata.plots.counts import PAIRS, STEERINGS
from ibdata.plots.style import count_bar, counted
from ibdata.plots.summary import Summary

TITLE = "Coverage"


def size(summary: Summary) -> tuple[float, float]:
    """(width, height) in inches."""
    return 4.8, 9.0


def draw(figure: Figure, summary: Summary) -> None:
    """Draw a square for each pair; white squares were never visited."""
    counts = summary.counts.coverage
    norm = LogNorm(1, max(2, counts.max()))
    for axes, (a, b), visits in zip(figure.subplots(len(PAIRS), 1), PAIRS, counts, strict=True):
        shown = counted(axes, visits, (0.0, 100.0, 0.0, 100.0), norm)
        axes.set_aspect("equal")
        axes.set_xlabel(summary.label(STEERINGS[a]))
        axes.set_ylabel(summary.label(STEERINGS[b]))
        axes.set_title(f"{np.count_nonzero(visits)} of {visits.size} squares visited")
    count_bar(figure, shown, figure.axes, shrink=0.5)
