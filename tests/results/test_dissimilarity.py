"""The text of docs/dissimilarity.md agrees with its tables, and the tables with a smaller measurement.

Bounds on means are 5 standard errors of the difference; the seed is fixed.
"""

from __future__ import annotations

import re

import numpy as np
import pytest
from helpers import ROOT
from helpers import script as load

TEXT = (ROOT / "docs/dissimilarity.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def script():
    return load("dissimilarity")


def listed(dynamics):
    """Means and half intervals by setpoint: fatigue and consumption after 1 step, then after 10."""
    part = TEXT.split(f"| `{dynamics}`: p′")[1].split("\n\n")[0]
    rows = [line for line in part.splitlines() if re.match(r"\| \d+ ", line)]
    cells = [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]
    return {float(c[0]): [tuple(map(float, x.split(" ± "))) for x in c[2:]] for c in cells}


@pytest.mark.parametrize("dynamics", ["siemens", "paper"])
def test_another_sample_gives_the_tables(script, dynamics):
    table = listed(dynamics)
    assert list(table) == list(script.SETPOINTS)
    for column, values in enumerate(script.measure(dynamics, n=150, draws=64, seed=1).values()):
        for i, p in enumerate(script.SETPOINTS):
            mean, half = table[p][column]
            error = values[i].std(ddof=1) / np.sqrt(values.shape[1])
            assert abs(values[i].mean() - mean) <= 5 * np.hypot(error, half / 1.96) + 0.01


@pytest.mark.parametrize("column", range(4))
def test_distance_grows_on_either_side_unequally(column):
    table = {p: cells[column][0] for p, cells in listed("siemens").items()}
    for side in ([p for p in table if p <= 50][::-1], [p for p in table if p >= 50]):
        distances = [table[p] for p in side]
        assert distances == sorted(distances)
        assert distances[0] == 0
    if column in (0, 2):
        assert table[10] > 2 * table[90]
    if column == 3:
        assert table[75] > table[20]


def test_in_paper_the_fatigue_knows_no_setpoint():
    assert all(cells[0][0] == cells[2][0] == 0 for cells in listed("paper").values())
