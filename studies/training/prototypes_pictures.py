"""The pictures of docs/prototypes.md."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ibdata.plots.style import SERIES, image
from measuring.documents import DOCS
from training import setpoint_map
from training.plan import FEW, FOUR, MODEL_BASED, SIZES, SOURCES, TARGET, TARGETS, WAYS, episodes_each, part
from training.protocol import AFTER_BURN_IN, AT_TEN
from training.prototypes_page import LABELS
from training.results import Results, means

ERRORS = (2, 5, 10, 20, 50, 100)
FOLDER = DOCS / "figures"
KNOWN = {
    "constant": ("no change", ":"),
    "safe": ("safe", "-."),
    "optimized": ("optimized", "--"),
    "expert": ("expert", "-"),
}
NAMES = {
    "target": "target alone",
    "source": "source alone",
    "pooled": "both pooled",
    "fine-tuned": "source, then target",
}


def write_pictures(results: Results, distances: dict[str, Any]) -> None:
    """Write all pictures."""
    drawings: dict[str, Callable[[Figure], None]] = {
        "batch": lambda figure: draw_batches(figure, results),
        "transfer": lambda figure: draw_transfer(figure, results),
        "map": lambda figure: draw_map(figure, results, distances),
    }
    for name, draw in drawings.items():
        (FOLDER / f"prototypes-{name}.png").write_bytes(image(draw, "png"))


def draw_batches(figure: Figure, results: Results) -> None:
    """Draw the mean return of each seed against the batch size, for both starts and both sets."""
    figure.set_size_inches(7.0, 5.4)
    axes = figure.subplots(2, 2, sharex=True, sharey="row")
    evaluations = {"from the default start": AT_TEN, "after a random burn-in": AFTER_BURN_IN}
    for column, name in enumerate(("random", "safe")):
        for row, (title, settings) in enumerate(evaluations.items()):
            axis = axes[row, column]
            for algorithm, (colour, marker, style) in zip(FOUR, SERIES, strict=False):
                sizes, values = [], []
                for count in SIZES[name]:
                    seeds = means(results.returns(name, episodes_each(count), algorithm, settings))
                    axis.plot([count * 10_000] * len(seeds), seeds, marker, color=colour, markersize=3)
                    sizes.append(count * 10_000)
                    values.append(np.mean(seeds) if seeds else np.nan)
                axis.plot(sizes, values, linestyle=style, color=colour, label=LABELS[algorithm])
            for policy, (label, style) in KNOWN.items():
                level = results.known(name, policy, settings).mean() / 100.0
                axis.axhline(level, color="0.5", linestyle=style, linewidth=0.8, label=label)
            axis.set(xscale="log", title=f"{name}, {title}")
            axis.set_xticks([10**4, 10**5, 10**6], ["10⁴", "10⁵", "10⁶"])
            axis.minorticks_off()
    for axis in axes[1]:
        axis.set_xlabel("transitions")
    figure.supylabel("mean return / 100 over ten setpoints", fontsize=9)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8)


def draw_transfer(figure: Figure, results: Results) -> None:
    """Draw the errors of models at the target against the episodes of the target, by way of learning."""
    figure.set_size_inches(7.0, 3.0)
    axes = figure.subplots(1, 3, sharey=True)
    panels = [("fatigue", 1), ("consumption", 1), ("consumption", 10)]
    for axis, (quantity, steps) in zip(axes, panels, strict=True):
        for way, (colour, marker, style) in zip(WAYS, SERIES, strict=False):
            by_count = [results.errors(part(way, count), MODEL_BASED, float(TARGET), steps) for count in FEW]
            values = [
                np.mean([getattr(e, quantity) for e in seeds]) if seeds else np.nan for seeds in by_count
            ]
            axis.plot(
                FEW, values, marker=marker, linestyle=style, color=colour, markersize=4, label=NAMES[way]
            )
            floor = [getattr(e, f"floor_{quantity}") for seeds in by_count for e in seeds]
        axis.axhline(np.mean(floor), color="0.5", linestyle=":", label="noise floor")
        axis.set_ylim(2.0, 100.0)
        axis.set(title=f"{quantity}, {steps} step{'s'[: steps > 1]}", xscale="log", yscale="log")
        axis.set_xticks(FEW, [str(count) for count in FEW])
        axis.set_yticks(ERRORS, [str(error) for error in ERRORS])
        axis.minorticks_off()
        axis.set_xlabel(f"episodes at {TARGET}")
    axes[0].set_ylabel("root mean square error")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, fontsize=8)


def draw_map(figure: Figure, results: Results, distances: dict[str, Any]) -> None:
    """Draw what the source alone gives at each target, and how far apart both are."""
    figure.set_size_inches(7.4, 2.9)
    axes = figure.subplots(1, 3, sharey=True)
    errors = setpoint_map.errors(results, "source", "consumption")
    apart = np.where(np.isnan(errors), np.nan, np.array(distances["consumption"]))
    panels = [
        ("dissimilarity, consumption", apart, "linear"),
        ("consumption error, 10 steps", errors, "log"),
        ("score of the policy", setpoint_map.scores(results), "linear"),
    ]
    for axis, (title, grid, scale) in zip(axes, panels, strict=True):
        mesh = axis.pcolormesh(TARGETS, SOURCES, grid, shading="nearest", cmap="viridis", norm=scale)
        axis.set(title=title, xlabel="target")
        bar = figure.colorbar(mesh, ax=axis, format="%g")
        if scale == "log":
            bar.set_ticks([20, 50, 100, 200])
            bar.minorticks_off()
    axes[0].set_ylabel("source")
