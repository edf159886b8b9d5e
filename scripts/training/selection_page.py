"""The tables of docs/policy-selection.md."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from measuring.documents import DOCS, table, write_measured
from training import selecting
from training.selecting import CHOSEN, ESTIMATORS, PER_DECISION, SETS, WEIGHTED, Line, plan

STEPS = ("1", "3", "100")  # of which the table of weights has the effective numbers
NAMES = dict(zip(ESTIMATORS, ("per-decision IS", "weighted IS", "FQE", "model"), strict=True))


def number(x: float, digits: int = 1) -> str:
    """A number with a true minus, and no sign if it is rounded to 0."""
    return f"{x:.{digits}f}".replace("-", "−") if round(x, digits) else f"{0.0:.{digits}f}"


def cell(found: selecting.Measure, digits: int) -> str:
    """A measure and its interval; – if there is none."""
    if np.isnan(found.value):
        return "–"
    return f"{number(found.value, digits)} [{number(found.low, digits)}, {number(found.high, digits)}]"


def of(lines: Sequence[Line], name: str) -> list[Line]:
    """The lines of a set."""
    return [line for line in lines if line.set == name]


def measures(lines: Sequence[Line]) -> str:
    """How good each estimator is on the policies of a set, in hundreds."""
    kinds = [(selecting.absolute_error, 1), (selecting.rank_correlation, 2)]
    kinds += [(partial(selecting.regret, k=k), 1) for k in CHOSEN]
    values, rows = selecting.values_of(lines) / 100, []
    for estimator in ESTIMATORS:
        estimates, cells = selecting.estimates_of(lines, estimator), ["–"] * len(kinds)
        if estimates is not None:
            cells = [cell(selecting.measured(values, estimates / 100, kind), n) for kind, n in kinds]
        rows.append([NAMES[estimator], *cells])
    return table(["estimator", "absolute error", "rank correlation", *(f"regret@{k}" for k in CHOSEN)], rows)


def covered(lines: Sequence[Line], estimator: str) -> str:
    """How many estimates there are, and how many of their 95 % intervals contain the true value."""
    found = [(line.estimates[estimator].interval, line.value.mean_return or 0.0) for line in lines]
    inside = [interval[0] <= value <= interval[1] for interval, value in found if interval is not None]
    return f"{sum(inside)} of {len(inside)}"


def weights(lines: Sequence[Line]) -> str:
    """What becomes of the weights of each set: median effective numbers of episodes, and the intervals."""
    rows = []
    for name in SETS:
        if own := of(lines, name):
            sizes = [[line.effective[n] for line in own] for n in STEPS]
            shown = [f"{np.median(size):,.1f}" for size in sizes]
            intervals = [covered(own, estimator) for estimator in (PER_DECISION, WEIGHTED)]
            rows.append([f"`{name.partition('/')[2]}`", *shown, *intervals])
    steps = [f"{n} step{'s' * (n != '1')}" for n in STEPS]
    return table(["set", *steps, NAMES[PER_DECISION], NAMES[WEIGHTED]], rows)


def block(lines: Sequence[Line]) -> str:
    """All that the page says of results."""
    errors = [line.value.standard_error or 0.0 for line in lines]
    parts = [
        f"{len(lines)} of {len(plan())} target policies are done. Returns are divided by 100; the standard "
        f"errors of the true values are at most {max(errors) / 100:.2f}."
    ]
    for name in SETS:
        own, wanted = of(lines, name), [one for one in plan() if one.set == name]
        parts.append(f"### Estimators on `{name}`")
        if len(own) < len(wanted):
            parts.append(f"{len(own)} of {len(wanted)} target policies are done; measures need all.")
            continue
        values = selecting.values_of(own) / 100
        low, middle, high = map(number, np.quantile(values, [0.0, 0.5, 1.0]))
        one, five = (number(selecting.chance_regret(values, k)) for k in CHOSEN)
        parts.append(f"True values: {low} to {high}, median {middle}. Regret of chance: {one} and {five}.")
        parts.append(measures(own))
    parts += [
        "### Importance weights",
        "Medians of the effective number of episodes, by the number of steps. The last two columns say how "
        "many of the 95 % intervals of the estimates contain the true value.",
        weights(lines),
    ]
    return "\n\n".join(parts)


def write_page(lines: Sequence[Line]) -> None:
    """Write the tables."""
    write_measured(DOCS / "policy-selection.md", f"\n{block(lines)}\n")
