"""The rewards at each setpoint: one histogram per row, all on the same scale."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ibdata.plots.style import BLUE
from ibdata.plots.summary import Summary

TITLE = "Rewards at each setpoint"
HIGHEST = 0.92  # the highest bar, as a share of a row


def size(summary: Summary) -> tuple[float, float]:
    """(width, height) in inches."""
    return 4.8, 1.4 + 0.3 * len(summary.episodes.setpoints)


def draw(figure: Figure, summary: Summary) -> None:
    """Draw the shares of a setpoint's steps upwards from its line."""
    counts = summary.counts
    shares = counts.rewards / np.maximum(counts.rewards.sum(axis=1, keepdims=True), 1)
    axes = figure.subplots()
    for i, share in enumerate(shares):
        heights = i + HIGHEST * share / shares.max()
        axes.stairs(heights, counts.reward_edges, baseline=i, fill=True, color=BLUE, alpha=0.8)
        axes.axhline(i, color="0.8", linewidth=0.5, zorder=0)
    axes.set_yticks(range(len(shares)), summary.episodes.setpoints)
    axes.locator_params(axis="x", nbins=6)
    axes.set_ylabel(summary.setpoint_label)
    axes.set_xlabel(summary.label("reward"))
    axes.set_title(f"share of each setpoint's steps; the highest bar is {shares.max():.1%}")
