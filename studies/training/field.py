"""The picture of docs/baselines.md: the scores of all algorithms on all sets, with their seeds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from ibdata.evaluation.baselines import BEHAVIOUR, NOTHING, PROTOTYPES, WHOLE, Baseline, shipped_baselines
from ibdata.plots.style import BLACK, SERIES, image
from measuring.documents import DOCS
from training.plan import MODEL_BASED
from training.prototypes_page import LABELS

Floats = npt.NDArray[np.float64]
PICTURE = DOCS / "figures" / "baselines.png"
ALGORITHMS = ["bc", "td3+bc", "iql", "cql", MODEL_BASED]
OF_PROTOTYPES = [
    ("random", "10 episodes each"),
    ("safe", "10 episodes each"),
    ("transfer", "10 at 75"),
    ("transfer", "100 at 50"),
    ("transfer", "100 at 50 + 10 at 75"),
]
ENDS_OF_WHOLE = [("siemens-offline/global-100", BEHAVIOUR), ("siemens-offline/optimized-0", BEHAVIOUR)]
ENDS = {name: [(name, BEHAVIOUR), (name, "optimized")] for name in ("random", "transfer")}
ENDS |= {"safe": [("safe", "random"), ("safe", "optimized")]}
LINEAR, HIGHEST, LOWEST = 100.0, 140.0, -3500.0  # scores; the axis is logarithmic below -LINEAR
TICKS = [-3000, -1000, -300, -100, -50, 0, 50, 100]
ROW, FIRST, APART = 0.2, -0.3, 0.15  # the height of a row in inches, and where its algorithms are in it


def means(line: Baseline) -> Floats:
    """The mean returns at the setpoints of the first evaluation, in the transfer of that at 75."""
    returns = next(e.values for e in line.evaluations if line.set != "transfer" or e.setpoint == 75.0)
    assert returns is not None
    found: Floats = returns.mean(axis=1)
    return found


def rows(lines: Sequence[Baseline]) -> list[tuple[str, dict[str, list[float]]]]:
    """The scores of the seeds of each algorithm, and of the behaviour, by the names of the rows.

    The reference policies were played in the same episodes, those of whole sets as behaviours.
    """
    sets = list(dict.fromkeys(line.set for line in lines if line.trained_on == WHOLE))
    every = [*lines, *shipped_baselines([PROTOTYPES])]
    known = {(line.set, line.algorithm): means(line) for line in every if line.seed is None}
    found = []
    for name, part in [*OF_PROTOTYPES, *((name, WHOLE) for name in sets)]:
        low, high = (known[ends] for ends in ENDS.get(name, ENDS_OF_WHOLE))
        of_row: dict[str, list[float]] = {}
        for line in every:
            is_behaviour = line.algorithm == BEHAVIOUR and line.trained_on in (NOTHING, WHOLE)
            is_shown = line.trained_on == part and line.algorithm in ALGORITHMS
            if line.set == name and (is_behaviour or is_shown):
                scores = 100.0 * (means(line) - low) / (high - low)
                of_row.setdefault(line.algorithm, []).append(float(scores.mean()))
        short = name.removeprefix("siemens-offline/")
        found.append((f"{name} ({part})" if name == "transfer" else short, of_row))
    return found


def draw(figure: Figure, lines: Sequence[Baseline]) -> None:
    """Draw a row a set: a bar for the behaviour, for each algorithm the mean and the seeds."""
    table = rows(lines)
    figure.set_size_inches(7.0, ROW * len(table) + 1.0)
    axes = figure.subplots()
    for row, (_, of_row) in enumerate(table):
        if row % 2:
            axes.axhspan(row - 0.5, row + 0.5, color="0.95", linewidth=0.0)
        axes.plot(of_row[BEHAVIOUR] * 2, [row - 0.42, row + 0.42], color=BLACK, linewidth=1.8, zorder=2)
        for i, (algorithm, (colour, marker, _)) in enumerate(zip(ALGORITHMS, SERIES, strict=False)):
            seeds, at = of_row.get(algorithm, []), row + FIRST + APART * i
            if seeds:
                axes.plot(seeds, [at] * len(seeds), "-|", color=colour, markersize=4, linewidth=0.8, zorder=3)
                axes.plot(np.mean(seeds), at, marker, color=colour, markersize=4.5, zorder=4)
    axes.set_xscale("symlog", linthresh=LINEAR, linscale=2.2)
    axes.set_xlim(LOWEST, HIGHEST)
    axes.set_xticks(TICKS, [f"{tick}".replace("-", "−") for tick in TICKS], fontsize=7.5)
    axes.set_xticks([], minor=True)
    axes.grid(axis="x", color="0.85", linewidth=0.6)
    axes.set_yticks(range(len(table)), [name for name, _ in table], fontsize=8)
    axes.set_ylim(len(table) - 0.5, -0.5)
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel("score: 0 = random, 100 = optimized; logarithmic below −100")
    for algorithm, (colour, marker, _) in zip(ALGORITHMS, SERIES, strict=False):
        axes.plot([], [], marker, color=colour, markersize=5, label=LABELS[algorithm])
    axes.plot([], [], "|", color=BLACK, markersize=11, markeredgewidth=1.8, label="behaviour")
    figure.legend(loc="outside upper center", ncols=6, fontsize=8.5, handletextpad=0.2, columnspacing=1.4)


def write_picture(lines: Sequence[Baseline]) -> None:
    """Draw the picture of the page."""
    PICTURE.write_bytes(image(lambda figure: draw(figure, lines), "png", dpi=200))
