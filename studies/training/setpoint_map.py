"""The transfer between all sources and targets, and whether a distance of setpoints predicts it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ibdata.dataset.reference_returns import scale
from measuring.documents import table
from training.distances import measure
from training.plan import MODEL, MODEL_BASED, SOURCES, TARGETS, THEN
from training.protocol import LITERATURE
from training.results import Results, number
from training.selection import rank_correlation

STATES, HORIZON = 500, 10
Floats = npt.NDArray[np.float64]


def distances(states: int = STATES) -> dict[str, list[list[float]]]:
    """The distance of docs/setpoints.md from each source to each target, after ten steps."""
    targets = [float(target) for target in TARGETS]
    rows = [measure("siemens", float(source), targets, n=states) for source in SOURCES]
    return {
        quantity: [np.round(row[HORIZON, quantity].mean(axis=1), 4).tolist() for row in rows]
        for quantity in ("fatigue", "consumption")
    }


def part_of(way: str, source: int, target: int) -> tuple[str, str]:
    """What is learned from, and by what, in one of the ways."""
    few = f"2 at {target}"
    ways = {
        "source": (f"100 at {source}", MODEL_BASED),
        "target": (few, MODEL),
        "fine-tuned": (f"100 at {source}{THEN}{few}", MODEL),
    }
    return ways[way]


def errors(results: Results, way: str, quantity: str) -> Floats:
    """The errors of models (sources, targets) after ten steps; NaN where both setpoints are equal."""
    grid = np.full((len(SOURCES), len(TARGETS)), np.nan)
    for i, source in enumerate(SOURCES):
        for j, target in enumerate(TARGETS):
            runs = results.errors(*part_of(way, source, target), float(target), HORIZON)
            if source != target and runs:
                grid[i, j] = getattr(runs[0], quantity)
    return grid


def scores(results: Results) -> Floats:
    """The reference scores (sources, targets) of the model-based policies that saw the source only."""
    known = scale("siemens", "default", LITERATURE["steps"], LITERATURE["discount"])
    assert known is not None
    grid = np.full((len(SOURCES), len(TARGETS)), np.nan)
    for i, source in enumerate(SOURCES):
        for j, target in enumerate(TARGETS):
            settings = {**LITERATURE, "setpoint": float(target)}
            returns = results.returns("transfer", f"100 at {source}", MODEL_BASED, settings)
            if returns:
                grid[i, j] = known.score(float(target), float(returns[0].mean()))
    return grid


def table_of(results: Results, measured: dict[str, list[list[float]]]) -> str:
    """Markdown tables of rank correlations, and of what the source adds to two episodes of the target."""
    apart = np.abs(np.subtract.outer(SOURCES, TARGETS)).astype(float)
    predictors = {"distance of the setpoints": apart}
    predictors |= {f"dissimilarity of {name}": np.array(grid) for name, grid in measured.items()}
    outcomes = {
        "fatigue error": errors(results, "source", "fatigue"),
        "consumption error": errors(results, "source", "consumption"),
        "score of the policy": scores(results),
    }
    rows = [
        [label, *(number(rank_over(grid, outcome), 2) for outcome in outcomes.values())]
        for label, grid in predictors.items()
    ]
    gain = errors(results, "fine-tuned", "consumption") / errors(results, "target", "consumption")
    cells = [
        [f"{source}", *("–" if np.isnan(x) else number(x, 2) for x in row)]
        for source, row in zip(SOURCES, gain, strict=True)
    ]
    return table(["", *outcomes], rows) + "\n\n" + table(["source, target:", *map(str, TARGETS)], cells)


def rank_over(predictor: Floats, outcome: Floats) -> float:
    """The rank correlation over all pairs of different setpoints that were run."""
    known = ~np.isnan(outcome)
    return rank_correlation(predictor[known], outcome[known])
