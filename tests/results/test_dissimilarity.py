"""The text of docs/setpoints.md agrees with its table, and the table with a smaller measurement.

Bounds on means are 5 standard errors of the difference; the seed is fixed.
"""

from __future__ import annotations

import re

import numpy as np
import pytest
from helpers import ROOT
from helpers import script as load

from measuring.documents import measured

TABLE = measured((ROOT / "docs/setpoints.md").read_text(encoding="utf-8"), "measured, dissimilarity")


def listed():
    """Means and half intervals by setpoint: fatigue and consumption after 1 step, then after 10."""
    rows = [line for line in TABLE.splitlines() if re.match(r"\| \d+ ", line)]
    cells = [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]
    return {float(c[0]): [tuple(map(float, x.split(" ± "))) for x in c[1:]] for c in cells}


@pytest.mark.parametrize("dynamics", ["siemens", "paper"])
def test_another_sample_gives_the_table(dynamics):
    """In `paper`, fatigue knows no setpoint, and consumption differs by at most 4 % more."""
    script, table, more = load("dissimilarity"), listed(), 0.04 if dynamics == "paper" else 0.0
    assert list(table) == list(script.SETPOINTS)
    found = script.measure(dynamics, script.SOURCE, script.SETPOINTS, n=60, draws=64, seed=1)
    for column, ((_, name), values) in enumerate(found.items()):
        if dynamics == "paper" and name == "fatigue":
            assert np.all(values == 0)
            continue
        for i, p in enumerate(script.SETPOINTS):
            mean, half = table[p][column]
            error = values[i].std(ddof=1) / np.sqrt(values.shape[1])
            assert abs(values[i].mean() - mean) <= 5 * np.hypot(error, half / 1.96) + 0.01 + more * mean


def test_distance_grows_on_either_side_unequally():
    means = {p: [mean for mean, _ in cells] for p, cells in listed().items()}
    for side in ([p for p in means if p <= 50][::-1], [p for p in means if p >= 50]):
        distances = np.array([means[p] for p in side])
        assert (np.diff(distances, axis=0) >= 0).all()
        assert (distances[0] == 0).all()
    assert means[10][0] > 2 * means[90][0]
    assert means[10][2] > 2 * means[90][2]
    further = [means[75][column] > means[20][column] for column in range(4)]  # fatigue and consumption, twice
    assert further == [False, False, False, True]
