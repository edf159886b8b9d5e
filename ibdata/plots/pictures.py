"""The pictures of a dataset: `draw_NAME(figure, summary)` for each name of `ibdata.plots.PICTURES`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator

from ibdata._numerics.arrays import Floats, Ints
from ibdata._numerics.naming import counted
from ibdata.plots.episode import PLOTTED, draw_episode
from ibdata.plots.style import GREYS, SERIES, WIDTH, count_bar, count_image, legend_above
from ibdata.plots.summary import ACTION_EDGES, DRAWN_COSTS, PAIRS, STEERINGS, Summary
from ibdata.views.options import ACTIONS

UNIFORM = 0.5  # the density of uniform actions
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
CLOSEST = 24  # times that neighbours fit between the lowest and the highest setpoint
FAR = 8.0  # times as large as the smallest is the largest value of a logarithmic axis
REWARD = "reward of a step: minus the cost, consumption + 3 · fatigue"
MOST_SPLITS = 24  # that are drawn
NONE = "(none)"
MOST_STEPS = 300  # more could not be told apart
LINES = 6  # most lines of equal reward
AREAS = (20.0, 80.0)  # of the marks of the lowest and the highest setpoint


def draw_actions(figure: Figure, summary: Summary) -> None:
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


def draw_coverage(figure: Figure, summary: Summary) -> None:
    """Draw a row of panels for each policy, and in it a panel for each pair."""
    figure.set_size_inches(WIDTH, 1.3 + 1.5 * len(summary.policies))
    counts = summary.counts.coverage
    norm = LogNorm(1, max(10, counts.max()))
    panels = figure.subplots(len(counts), len(PAIRS), sharex=True, sharey=True, squeeze=False)
    for row, pictures, name in zip(panels, counts, summary.policies, strict=True):
        for axes, (_, b), visits in zip(row, PAIRS, pictures, strict=True):
            shown = count_image(axes, visits, (0.0, 100.0, 0.0, 100.0), norm)
            axes.set_aspect("equal")
            axes.set_ylabel(summary.label(STEERINGS[b]), labelpad=1)
            axes.set_title(f"{np.count_nonzero(visits) / visits.size:.1%}", loc="right", size=8)
        row[0].set_title(f"{name}\n", loc="left")
    for axes, (a, _) in zip(panels[-1], PAIRS, strict=True):
        axes.set_xlabel(summary.label(STEERINGS[a]))
    count_bar(figure, shown, figure.axes, location="bottom", shrink=0.6, aspect=40)
    figure.suptitle(f"%: share of the {visits.size:,} squares that were visited; the others are white")


def draw_returns(figure: Figure, summary: Summary) -> None:
    """Draw the spread of the returns, or of the mean rewards if lengths differ."""
    values, label = summary.returns, "return: the sum of an episode's rewards"
    lengths = summary.episodes["length"].to_numpy()
    if np.ptp(lengths) > 0:
        values, label = values / lengths, "mean reward of a step; the episodes differ in length"
    quantiles = np.full((len(summary.setpoints), len(summary.policies), len(QUANTILES)), np.nan)
    for i, j in np.unique([summary.setpoint, summary.policy], axis=1).T:
        chosen = (summary.setpoint == i) & (summary.policy == j)
        quantiles[i, j] = np.quantile(values[chosen], QUANTILES)
    _draw_spread(figure, summary, quantiles, f"{label} (minus its costs)", "the episodes")


def draw_rewards(figure: Figure, summary: Summary) -> None:
    """Draw the spread of the rewards."""
    counts = summary.counts
    quantiles = np.full((*counts.rows.shape, len(QUANTILES)), np.nan)
    for i, j in np.argwhere(counts.rows):  # the steps of a bin are spread evenly within it
        below = np.concatenate([[0.0], np.cumsum(counts.rewards[i, j]) / counts.rows[i, j]])
        quantiles[i, j] = np.interp(QUANTILES, below, counts.reward_edges)
    _draw_spread(figure, summary, quantiles, REWARD, "the steps")


def _draw_spread(figure: Figure, summary: Summary, quantiles: Floats, label: str, what: str) -> None:
    """Draw quantiles (setpoints, policies, 5), which are NaN where a policy does not occur."""
    setpoints, levels, policies = summary.setpoints, summary.levels, summary.policies
    apart = max(np.diff(levels).min(), np.ptp(levels) / CLOSEST) if len(levels) > 1 else 1.0
    figure.set_size_inches(WIDTH, 2.0 + 0.14 * len(setpoints) * max(2, len(policies)))
    axes = figure.subplots()
    for j, (name, (color, marker, _)) in enumerate(zip(policies, SERIES, strict=False)):
        there = np.isfinite(quantiles[:, j, 0])
        places = levels[there] - 0.8 * apart * ((j + 0.5) / len(policies) - 0.5)
        low, lower, median, upper, high = quantiles[there, j].T
        axes.hlines(places, low, high, color=color, linewidth=0.8)
        axes.hlines(places, lower, upper, color=color, linewidth=2.5)
        axes.plot(median, places, marker, color=color, markersize=4.5, markeredgewidth=0, label=name)
    _scale(axes, quantiles[np.isfinite(quantiles)])
    if np.diff(levels, prepend=-np.inf).min() >= apart:  # else their labels would overlap
        axes.set_yticks(levels, setpoints)
    axes.set_ylim(levels[0] - 0.5 * apart, levels[-1] + 0.5 * apart)
    axes.set_ylabel(summary.setpoint_label)
    axes.set_xlabel(label)
    axes.grid(axis="x", which="both", color="0.9")
    axes.set_axisbelow(True)
    legend_above(axes)
    figure.suptitle(f"mark: median; thick line: quartiles; thin line: 5 to 95 % of {what}")


def _scale(axes: Axes, values: Floats) -> None:
    """Make the axis logarithmic if the values are all negative and far apart."""
    near, far = -values.max(), -values.min()
    if near > 0.0 and far > FAR * near:
        axes.set_xscale("symlog", linthresh=near, subs=[2, 5])
        axes.xaxis.set_minor_formatter(EngFormatter(sep=""))
        axes.tick_params(axis="x", which="minor", length=3.5)  # as long as that of a power of ten
        axes.set_xlim(-1.2 * far, -0.8 * near)
    else:
        axes.locator_params(axis="x", nbins=5)
    axes.xaxis.set_major_formatter(EngFormatter(sep=""))


def draw_splits(figure: Figure, summary: Summary) -> None:
    """Draw cells by splits above, and splits by splits below."""
    held = [tuple(splits) or (NONE,) for splits in summary.episodes["splits"]]
    names = [*list(summary.dataset.stored.splits)[:MOST_SPLITS], *([NONE] if (NONE,) in held else [])]
    inside = np.array([[name in splits for name in names] for splits in held], np.int64)
    labels = [f"{p}, {policy}" for p in summary.setpoints for policy in summary.policies]
    cells = np.zeros((len(labels), len(names)), np.int64)
    np.add.at(cells, summary.setpoint * len(summary.policies) + summary.policy, inside)
    figure.set_size_inches(max(WIDTH, 2.0 + 0.4 * len(names)), 2.4 + 0.2 * len(labels) + 0.22 * len(names))
    upper, lower = figure.subplots(2, 1, height_ratios=[len(labels) + 1, len(names) + 1])
    _count(upper, cells, names, labels)
    _count(lower, inside.T @ inside, names, names)
    lower.set_title("episodes that two splits share", loc="left")
    more = len(summary.dataset.stored.splits) - MOST_SPLITS
    figure.suptitle(
        f"episodes by {summary.setpoint_label} and policy"
        + (f"; and {counted(more, 'split')} more" if more > 0 else "")
    )


def _count(axes: Axes, numbers: Ints, columns: list[str], rows: list[str]) -> None:
    """Write numbers into squares that are the darker the larger they are; 0 is an empty square."""
    blues = colormaps["Blues"].resampled(256)  # a user's setting `image.lut` may have made it coarse
    axes.imshow(np.log1p(numbers), cmap=blues, vmin=0, vmax=2 * np.log1p(numbers.max()), aspect="auto")
    for i, j in np.argwhere(numbers):
        axes.text(j, i, f"{numbers[i, j]:,}", ha="center", va="center", fontsize=9)
    axes.set_xticks(range(len(columns)), columns, rotation=40, ha="right", rotation_mode="anchor")
    axes.set_yticks(range(len(rows)), rows)
    axes.tick_params(length=0)


def draw_traces(figure: Figure, summary: Summary) -> None:
    """Draw the panels of `ibdata.plots.episode`."""
    median = np.quantile(summary.returns, 0.5, method="inverted_cdf")
    episode = summary.episodes.iloc[np.argmax(summary.returns == median)]  # the first of several
    steps = _traces(summary, episode)
    figure.set_size_inches(WIDTH, 5.4 if "mu_v" in steps else 3.4)
    draw_episode(figure, steps)
    figure.axes[-1].set_xlim(0, max(1, len(steps["setpoint"]) - 1))
    cut = f", first {MOST_STEPS:,} steps" if episode["length"] > MOST_STEPS else ""
    figure.suptitle(
        f"episode {episode['episode']:,}, the one with the median return{cut}\n"
        f"{summary.setpoint_label} = {episode['setpoint']:g}, {episode['policy']}"
    )


def _traces(summary: Summary, episode: Any) -> Mapping[str, Floats]:
    """The first steps of an episode: variables by name, with the hidden ones that the dataset has."""
    known = {column.name for column in summary.dataset.stored.info.columns}
    both = {column: name for name in PLOTTED for column in (f"obs_{name}", f"latent_{name}")}
    names = [column for column in both if column in known]
    first, stop = int(episode["row_start"]), int(episode["row_stop"])
    batches = summary.dataset.stored.batches(
        int(episode["shard"]), names, MOST_STEPS, first, min(stop, first + MOST_STEPS)
    )
    parts = [np.stack([column.to_numpy() for column in batch.columns]) for batch in batches]
    return dict(zip([both[name] for name in names], np.concatenate(parts, axis=1), strict=True))


def draw_tradeoff(figure: Figure, summary: Summary) -> None:
    """Draw all steps in grey, the mean of each setpoint and policy, and lines of equal reward."""
    figure.set_size_inches(WIDTH, 4.6)
    counts, setpoints = summary.counts, summary.setpoints
    x, y = counts.cost_edges
    axes = figure.subplots()
    norm = LogNorm(1, max(10, counts.costs.max()))
    shown = count_image(axes, counts.costs, (x[0], x[-1], y[0], y[-1]), norm, GREYS)
    areas = np.linspace(*AREAS, len(setpoints))
    for j, (name, (color, marker, _)) in enumerate(zip(summary.policies, SERIES, strict=False)):
        x_means, y_means = counts.mean_costs[:, j].T  # where there are no rows, NaN, and no mark
        axes.scatter(x_means, y_means, s=areas, color=color, marker=marker, edgecolors="white",
                     label=name, clip_on=False, zorder=2)  # fmt: skip
    far = np.nanmax(counts.mean_costs, axis=(0, 1))  # a rare policy's mean may be beyond the axes
    axes.set_xlim(min(0.0, x[0]), max(x[-1], far[0]))
    axes.set_ylim(min(0.0, y[0]), max(y[-1], far[1]))
    totals = MaxNLocator(LINES).tick_values(x[0] + 3 * y[0], x[-1] + 3 * y[-1])
    for total in totals:
        axes.axline((total, 0.0), (total - 3.0, 1.0), color="0.3", linewidth=0.6, linestyle=":")
    axes.set_xlabel(summary.label(DRAWN_COSTS[0]))
    axes.set_ylabel(summary.label(DRAWN_COSTS[1]))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:,g}")
    count_bar(figure, shown, axes, aspect=40)
    legend_above(axes)
    marks = f"marks: means at setpoint {setpoints[0]}"
    if len(setpoints) > 1:
        marks = f"marks: means\nat setpoints {setpoints[0]} (small) to {setpoints[-1]} (large)"
    beyond = 1.0 - counts.costs.sum() / counts.rows.sum()
    figure.suptitle(
        f"dotted: equal reward, {totals[1] - totals[0]:,g} apart; {marks}"
        + (f"\nbeyond the axes: {beyond:.2%} of all steps" if beyond > 0 else "")
    )
