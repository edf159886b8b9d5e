"""How many episodes of each setpoint and policy a split holds, and how many two splits share."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ibdata.numerics.naming import counted
from ibdata.plots.groups import Numbers
from ibdata.plots.summary import Summary

TITLE = "Splits"
MOST = 24  # splits that are drawn
NONE = "(none)"


def names(summary: Summary) -> list[str]:
    """The first 24 splits, and `NONE` where there are episodes in no split."""
    return [
        *list(summary.dataset.splits)[:MOST],
        *([NONE] if () in summary.episodes.splits else []),
    ]


def membership(summary: Summary) -> Numbers:
    """Whether episodes are in splits: 1 or 0, (episodes, splits)."""
    known = {name: i for i, name in enumerate(names(summary))}
    out = np.zeros((len(summary.episodes.splits), len(known)), np.int64)
    for row, own in zip(out, summary.episodes.splits, strict=True):
        row[[known[name] for name in own or (NONE,) if name in known]] = 1
    return out


def counts(summary: Summary) -> Numbers:
    """The number of a cell's episodes in a split (setpoints · policies, splits)."""
    cell, inside = summary.episodes.cell(), membership(summary)
    made = np.zeros(
        (len(summary.episodes.setpoints) * len(summary.episodes.policies), inside.shape[1]), np.int64
    )
    np.add.at(made, cell, inside)
    return made


def size(summary: Summary) -> tuple[float, float] | None:
    """(width, height) in inches; None if the dataset has no splits."""
    if not summary.dataset.splits:
        return None
    own, rows = len(names(summary)), len(summary.episodes.setpoints) * len(summary.episodes.policies)
    return max(4.8, 2.0 + 0.4 * own), 2.4 + 0.2 * rows + 0.22 * own


def draw(figure: Figure, summary: Summary) -> None:
    """Draw cells by splits above, and splits by splits below."""
    episodes, own, inside = summary.episodes, names(summary), membership(summary)
    cells, shared = counts(summary), inside.T @ inside
    upper, lower = figure.subplots(2, 1, height_ratios=[len(cells) + 1, len(own) + 1])
    _count(upper, cells, own, [f"{p}, {policy}" for p in episodes.setpoints for policy in episodes.policies])
    _count(lower, shared, own, own)
    lower.set_title("episodes that two splits share", loc="left")
    more = len(summary.dataset.splits) - MOST
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
