"""The actions of each policy."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from ibdata.plots.counts import ACTION_EDGES, ACTIONS
from ibdata.plots.style import SERIES
from ibdata.plots.summary import Summary

TITLE = "Actions of each policy"


def size(summary: Summary) -> tuple[float, float]:
    """(width, height) in inches."""
    return 4.8, 5.6


def draw(figure: Figure, summary: Summary) -> None:
    """Draw a panel for each number of the action: shares of the policy's steps, on a logarithmic scale."""
    counts = summary.counts.actions
    least = min(0.5, 50.0 / counts.sum(axis=2).max())  # share of half a step, in %
    panels = figure.subplots(len(ACTIONS), 1, sharex=True, sharey=True)
    for i, (axes, column) in enumerate(zip(panels, ACTIONS, strict=True)):
        for own, name, (color, _, line) in zip(counts[:, i], summary.episodes.policies, SERIES, strict=False):
            share = 100.0 * own / max(1, own.sum())
            axes.stairs(np.maximum(share, least), ACTION_EDGES, baseline=least, color=color, linestyle=line,
                        linewidth=1.2, label=name if i == 0 else None)  # fmt: skip
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.set_ylim(least, 130)
        axes.set_xlabel(summary.label(column))
    panels[1].set_ylabel("share of the policy's steps (%)")
    figure.legend(loc="outside upper left", ncols=3)
