"""The two costs of every step, fatigue and consumption. Steps at the lower left have the highest reward."""

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ibdata.plots.counts import COSTS
from ibdata.plots.style import GREYS, SERIES, WIDTH, count_bar, counted, legend_above
from ibdata.plots.summary import Summary

TITLE = "Fatigue against consumption"
LINES = 6  # most lines of equal reward
AREAS = (20.0, 80.0)  # of the marks of the lowest and the highest setpoint


def draw(figure: Figure, summary: Summary) -> None:
    """Draw all steps in grey, the mean of each setpoint and policy, and lines of equal reward."""
    figure.set_size_inches(WIDTH, 4.6)
    counts, setpoints = summary.counts, summary.setpoints
    x, y = counts.cost_edges
    axes = figure.subplots()
    norm = LogNorm(1, max(10, counts.costs.max()))
    shown = counted(axes, counts.costs, (x[0], x[-1], y[0], y[-1]), norm, GREYS)
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
    axes.set_xlabel(summary.label(COSTS[0]))
    axes.set_ylabel(summary.label(COSTS[1]))
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
