"""Which splits hold which setpoints and policies, and how many episodes two of them share."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ibdata.plots.groups import Floats, Numbers
from ibdata.plots.summary import Summary

TITLE = "Splits"
MOST = 24  # splits that are drawn
NONE = "(none)"


def names(summary: Summary) -> list[str]:
    """The first 24 splits, and `NONE` for episodes in no split."""
    return [*list(summary.dataset.info_model.splits)[:MOST], NONE]


def membership(summary: Summary) -> Numbers:
    """Whether episodes are in splits: 1 or 0, (episodes, splits)."""
    known = {name: i for i, name in enumerate(names(summary))}
    out = np.zeros((len(summary.episodes.splits), len(known)), np.int64)
    for row, own in zip(out, summary.episodes.splits, strict=True):
        row[[known[name] for name in own or (NONE,) if name in known]] = 1
    return out


def shares(summary: Summary) -> Floats:
    """The share of a cell's episodes in a split (setpoints · policies, splits); NaN in empty cells."""
    cell, inside = summary.episodes.cell(), membership(summary)
    counts = np.zeros((len(summary.episodes.setpoints) * len(summary.episodes.policies), inside.shape[1]))
    np.add.at(counts, cell, inside)
    sizes = np.bincount(cell, minlength=len(counts))
    return np.where(sizes[:, None] > 0, counts, np.nan) / np.maximum(sizes, 1)[:, None]


def size(summary: Summary) -> tuple[float, float]:
    """(width, height) in inches."""
    own, rows = len(names(summary)), len(summary.episodes.setpoints) * len(summary.episodes.policies)
    return max(4.8, 2.0 + 0.25 * own), 2.8 + (0.17 if rows <= 40 else 0.12) * rows + 0.25 * own


def draw(figure: Figure, summary: Summary) -> None:
    """Draw cells by splits above, and splits by splits below."""
    episodes, own = summary.episodes, names(summary)
    inside = membership(summary)
    share, shared = shares(summary), inside.T @ inside
    upper, lower = figure.subplots(2, 1, height_ratios=[len(share), len(own) + 2])
    rows = [f"{p}, {policy}" for p in episodes.setpoints for policy in episodes.policies]
    shown = upper.imshow(np.ma.masked_invalid(share), cmap="cividis", vmin=0, vmax=1, aspect="auto")
    _name(upper, own, rows)
    upper.set_ylabel(f"{summary.setpoint_label}, policy")
    more = len(summary.dataset.info_model.splits) - MOST
    upper.set_title(
        "share of the cell's episodes in the split" + (f"; {more} more splits" if more > 0 else "")
    )
    figure.colorbar(shown, ax=upper, shrink=0.6)
    lower.imshow(
        np.log1p(shared), cmap="Greys", vmin=0, vmax=max(1.0, 2 * np.log1p(shared.max())), aspect="auto"
    )
    for i, j in np.ndindex(shared.shape):
        lower.text(j, i, f"{shared[i, j]}", ha="center", va="center", fontsize=6.5)
    _name(lower, own, own)
    lower.set_title("episodes that two splits share")


def _name(axes: Axes, columns: list[str], rows: list[str]) -> None:
    axes.set_xticks(range(len(columns)), columns, rotation=40, ha="right", rotation_mode="anchor")
    axes.set_yticks(range(len(rows)), rows, fontsize=7)
    axes.tick_params(length=0)
