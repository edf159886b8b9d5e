"""The episode with the median return: observed variables and, if the dataset has them, hidden ones."""

from __future__ import annotations

from matplotlib.figure import Figure

from ibdata.plots.episode import draw as draw_episode
from ibdata.plots.summary import MOST_STEPS, Summary

TITLE = "One episode"


def size(summary: Summary) -> tuple[float, float]:
    """(width, height) in inches."""
    return 4.8, 5.4 if "mu_v" in summary.traces else 3.4


def draw(figure: Figure, summary: Summary) -> None:
    """Draw the panels of `ibdata.plots.episode`."""
    draw_episode(figure, summary.traces)
    figure.axes[-1].set_xlim(0, max(1, len(summary.traces["setpoint"]) - 1))
    episode = summary.dataset.episodes.iloc[summary.typical]
    cut = f", first {MOST_STEPS} steps" if episode["length"] > MOST_STEPS else ""
    figure.suptitle(
        f"episode {summary.typical}, the one with the median return{cut}\n"
        f"{summary.setpoint_label} = {episode['setpoint']:g}, {episode['policy']}"
    )
