"""The tables of docs/policy-selection.md."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from measuring.documents import DOCS, replaced
from training.page import LABELS
from training.selecting import (
    AT,
    CHOSEN,
    ESTIMATORS,
    FQE,
    GRID,
    MODEL,
    PER_DECISION,
    SETS,
    WEIGHTED,
    Checkpoint,
    Line,
    Measure,
    absolute_error,
    chance_regret,
    estimates_of,
    measured,
    plan,
    rank_correlation,
    regret,
    values_of,
)

PAGE = DOCS / "policy-selection.md"
NAMES = {PER_DECISION: "per-decision IS", WEIGHTED: "weighted IS", FQE: "FQE", MODEL: "model"}


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [f"| {' | '.join(row)} |" for row in (head, *rows)]
    return "\n".join([lines[0], "|---" * len(head) + "|", *lines[1:]])


def number(x: float, digits: int = 1) -> str:
    """A number with a true minus, and no sign if it is rounded to 0."""
    return f"{x:.{digits}f}".replace("-", "−") if round(x, digits) else f"{0.0:.{digits}f}"


def cell(found: Measure, digits: int) -> str:
    """A measure and its interval; – if there is none."""
    if np.isnan(found.value):
        return "–"
    return f"{number(found.value, digits)} [{number(found.low, digits)}, {number(found.high, digits)}]"


def of(lines: Sequence[Line], name: str) -> list[Line]:
    """The lines of a set."""
    return [line for line in lines if line.set == name]


def true_values(lines: Sequence[Line]) -> str:
    """The true values, a row for each training."""
    found = {line.key: line.value.mean_return for line in lines}
    rows = []
    for name in SETS:
        for algorithm in AT:
            values = [found.get(Checkpoint(name, algorithm, steps)) for steps in GRID]
            if any(x is not None for x in values):
                shown = ["–" if x is None else number(x / 100) for x in values]
                rows.append([f"`{name.partition('/')[2]}`", LABELS[algorithm], *shown])
    return table(["set", "algorithm", *(f"{steps:,}" for steps in GRID)], rows)


def measures(lines: Sequence[Line]) -> str:
    """How good each estimator is on the policies of a set, in hundreds."""
    values, rows = values_of(lines) / 100, []
    for estimator in ESTIMATORS:
        estimates, none = estimates_of(lines, estimator), ["–"] * (2 + len(CHOSEN))
        if estimates is not None:
            found = [measured(values, estimates / 100, absolute_error)]
            found += [measured(values, estimates / 100, partial(regret, k=k)) for k in CHOSEN]
            ranked = measured(values, estimates / 100, rank_correlation)
            none = [cell(found[0], 1), cell(ranked, 2), *(cell(each, 1) for each in found[1:])]
        rows.append([NAMES[estimator], *none])
    chance = (number(chance_regret(values, k)) for k in CHOSEN)
    rows.append(["drawing policies at random", "–", "–", *chance])
    head = ["estimator", "absolute error", "rank correlation", *(f"regret@{k}" for k in CHOSEN)]
    return table(head, rows)


def covered(lines: Sequence[Line], estimator: str) -> str:
    """How many estimates there are, and how many of their 95 % intervals contain the true value."""
    found = [(line.estimates[estimator].interval, line.value.mean_return or 0.0) for line in lines]
    inside = [interval[0] <= value <= interval[1] for interval, value in found if interval is not None]
    return f"{sum(inside)} of {len(inside)}"


def weights(lines: Sequence[Line]) -> str:
    """What becomes of the weights, a row for each set: median effective sample sizes, and the intervals."""
    rows = []
    for name in SETS:
        if own := of(lines, name):
            sizes = [[line.effective[n] for line in own] for n in own[0].effective]
            shown = [f"{np.median(size):,.1f}" for size in sizes]
            intervals = [covered(own, estimator) for estimator in (PER_DECISION, WEIGHTED)]
            rows.append([f"`{name.partition('/')[2]}`", *shown, *intervals])
    steps = [f"{n} step{'s' * (n != '1')}" for n in lines[0].effective]
    return table(["set", *steps, NAMES[PER_DECISION], NAMES[WEIGHTED]], rows)


def times(lines: Sequence[Line]) -> str:
    """The median CPU seconds for one policy."""
    rows = []
    for name in lines[0].cpu_seconds:
        seconds = [line.cpu_seconds[name] for line in lines]
        rows.append([name, f"{np.median(seconds):.1f}", f"{min(seconds):.1f} to {max(seconds):.1f}"])
    return table(["what", "median seconds", "from, to"], rows)


def block(lines: Sequence[Line]) -> str:
    """All that the page says of results."""
    errors = [line.value.standard_error or 0.0 for line in lines]
    parts = [
        f"{len(lines)} of {len(plan())} target policies are done. Returns are divided by 100.",
        "### True values",
        "By the steps of training. – stands for what is no target policy, or was not run yet. The standard "
        f"errors are at most {max(errors) / 100:.2f}.",
        true_values(lines),
    ]
    for name in SETS:
        own, wanted = of(lines, name), [one for one in plan() if one.set == name]
        parts.append(f"### Estimators on `{name}`")
        if len(own) < len(wanted):
            parts.append(f"{len(own)} of {len(wanted)} target policies are done; measures need all.")
            continue
        low, middle, high = (number(x / 100) for x in np.quantile(values_of(own), [0.0, 0.5, 1.0]))
        parts.append(f"True values: worst {low}, median {middle}, best {high}.")
        parts.append(measures(own))
    parts += [
        "### Importance weights",
        "Medians over the target policies of the effective sample size, by the number of steps. The last two "
        "columns say how many of the 95 % intervals of the estimates contain the true value.",
        weights(lines),
        "### Time",
        "CPU seconds for one target policy, without the fit of the model, which is made once per set.",
        times(lines),
    ]
    return "\n\n".join(parts)


def write_page(lines: Sequence[Line]) -> None:
    """Write the tables."""
    page = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(replaced(page, f"\n{block(lines)}\n"), encoding="utf-8")
