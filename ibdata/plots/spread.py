"""The spread of a value at each setpoint, by policy: quantiles as lines and marks."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter

from ibdata.plots.style import SERIES, WIDTH, Floats, legend_above
from ibdata.plots.summary import Summary

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
CLOSEST = 24  # times that neighbours fit between the lowest and the highest setpoint
FAR = 8.0  # times as large as the smallest is the largest value of a logarithmic axis


def draw_spread(figure: Figure, summary: Summary, quantiles: Floats, label: str, what: str) -> None:
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
