"""The rewards at each setpoint, by policy: -consumption - 3 · fatigue of the next observation."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ibdata.plots.style import SERIES, legend_above
from ibdata.plots.summary import Summary

TITLE = "Rewards"
HIGHEST = 0.92  # the highest bar of a setpoint, as a share of its row


def size(summary: Summary) -> tuple[float, float]:
    """(width, height) in inches."""
    row = 0.22 + 0.1 * min(3, len(summary.episodes.policies))
    return 4.8, 1.8 + max(1.0, row * len(summary.episodes.setpoints))


def draw(figure: Figure, summary: Summary) -> None:
    """Draw the shares of steps upwards from each setpoint's line, a histogram for each policy."""
    counts, episodes = summary.counts, summary.episodes
    shares = counts.rewards / np.maximum(counts.rows, 1)[..., None]
    axes = figure.subplots()
    for i, row in enumerate(HIGHEST * shares / np.maximum(shares.max(axis=(1, 2), keepdims=True), 1e-12)):
        for share, name, (color, _, line) in zip(row, episodes.policies, SERIES, strict=False):
            axes.stairs(i + share, counts.reward_edges, baseline=i, fill=True, color=color, alpha=0.4)
            axes.stairs(i + share, counts.reward_edges, baseline=i, color=color, linestyle=line,
                        linewidth=0.8, label=None if i else name)  # fmt: skip
        axes.axhline(i, color="0.8", linewidth=0.5, zorder=0)
    axes.set_yticks(range(len(shares)), episodes.setpoints)
    axes.set_xlim(counts.reward_edges[0], counts.reward_edges[-1])
    axes.locator_params(axis="x", nbins=6)
    axes.set_ylabel(summary.setpoint_label)
    axes.set_xlabel(summary.label("reward"))
    legend_above(axes)
    beyond = 1.0 - counts.rewards.sum() / counts.rows.sum()
    figure.suptitle(
        "share of a policy's steps; each setpoint has a scale of its own"
        + (f"\nbeyond the axis: {beyond:.2%} of all steps" if beyond > 0 else "")
    )
