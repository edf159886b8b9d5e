"""How many episodes of each setpoint and policy a split holds, and how many two splits share."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ibdata.numerics.naming import counted
from ibdata.plots.style import WIDTH, Numbers
from ibdata.plots.summary import Summary

TITLE = "Splits"
MOST = 24  # splits that are drawn
NONE = "(none)"


def draw(figure: Figure, summary: Summary) -> None:
    """Draw cells by splits above, and splits by splits below."""
    held = [tuple(splits) or (NONE,) for splits in summary.episodes["splits"]]
    names = [*list(summary.dataset.stored.splits)[:MOST], *([NONE] if (NONE,) in held else [])]
    inside = np.array([[name in splits for name in names] for splits in held], np.int64)
    labels = [f"{p}, {policy}" for p in summary.setpoints for policy in summary.policies]
    cells = np.zeros((len(labels), len(names)), np.int64)
    np.add.at(cells, summary.setpoint * len(summary.policies) + summary.policy, inside)
    figure.set_size_inches(max(WIDTH, 2.0 + 0.4 * len(names)), 2.4 + 0.2 * len(labels) + 0.22 * len(names))
    upper, lower = figure.subplots(2, 1, height_ratios=[len(labels) + 1, len(names) + 1])
    _count(upper, cells, names, labels)
    _count(lower, inside.T @ inside, names, names)
    lower.set_title("episodes that two splits share", loc="left")
    more = len(summary.dataset.stored.splits) - MOST
    figure.suptitle(
        f"episodes by {summary.setpoint_label} and policy"
        + (f"; and {counted(more, 'split')} more" if more > 0 else "")
    )


def _count(axes: Axes, numbers: Numbers, columns: list[str], rows: list[str]) -> None:
    """Write numbers into squares that are the darker the larger they are; 0 is an empty square."""
    axes.imshow(np.log1p(numbers), cmap="Blues", vmin=0, vmax=2 * np.log1p(numbers.max()), aspect="auto")
    for i, j in np.argwhere(numbers):
        axes.text(j, i, f"{numbers[i, j]:,}", ha="center", va="center", fontsize=9)
    axes.set_xticks(range(len(columns)), columns, rotation=40, ha="right", rotation_mode="anchor")
    axes.set_yticks(range(len(rows)), rows)
    axes.tick_params(length=0)
