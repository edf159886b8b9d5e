"""docs/errata.md agrees with the code that it describes, and its tables with a smaller measurement.

The tables hold means over 10,000 episodes with seed 0. Here some are measured again over fewer episodes with
another, fixed seed. Bounds are 5 standard errors of the difference, which exceeds them by chance in 6e-7 of
cases.
"""

from __future__ import annotations

import math
import re
from fractions import Fraction

import pytest
from helpers import ROOT
from helpers import script as load

from ibdata.dynamics import PAPER, SIEMENS, variants

TEXT = (ROOT / "docs" / "errata.md").read_text(encoding="utf-8")
FIELDS = [name for name, field in variants.FIELDS.items() if field.paper != field.siemens]
SEED, SIGMAS = 1, 5.0


@pytest.fixture(scope="module")
def script():
    return load("errata")


def table_of_differences():
    """Field → (cell of the paper, cell of the code)."""
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in TEXT.splitlines()]
    return {row[1].strip("`"): (row[3], row[4]) for row in rows if len(row) == 5 and row[1].startswith("`")}


def parse(document, sample):
    """The numbers of the tables of effects, by row and column."""
    found, header = {}, []
    for line in document.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("|  |"):
            header = cells
        elif line.startswith("| ") and "±" in line:
            for column, cell in zip(header[1:], cells[1:], strict=True):
                found[cells[0].strip("`"), column] = sample(*map(float, cell.split("±")))
    return found


def numbers(value):
    """The numbers of a value, or of a cell in which 1/9 is a number, in order."""
    if isinstance(value, str):
        return [float(Fraction(x)) for x in re.findall(r"-?\d+(?:\.\d+)?(?:/\d+)?", value)]
    return [float(value)] if isinstance(value, int | float) else [x for part in value for x in numbers(part)]


def test_every_field_has_both_values_a_belief_and_a_measured_row(script):
    table, measured = table_of_differences(), parse(TEXT, script.Sample)
    assert list(table) == FIELDS
    beliefs = TEXT.partition("## Which was meant\n")[2].partition("\n## ")[0]
    assert sorted(re.findall(r"^- `(\w+)`: ", beliefs, flags=re.MULTILINE)) == sorted(FIELDS)
    for name, (paper, code) in table.items():
        assert numbers(paper) == numbers(getattr(PAPER, name))
        assert numbers(code) == numbers(getattr(SIEMENS, name))
        assert numbers(paper) != numbers(code)
        moving = name.startswith("drift")
        for p in script.ENDS:
            assert ((name, f"reward, from {p}") in measured) == moving
            assert ((name, f"reward, p = {p}") in measured) != moving
            assert ((name, f"setpoint, from {p}") in measured) == moving


def measured_again(script, name, p, quantity, drifting=False):
    """A difference to `siemens`, or `siemens` itself, measured with another seed."""
    options = {"episodes": 100 if drifting else 200, "seed": SEED}
    base = script.measure("siemens", p, drifting, **options)[quantity]
    if name == "siemens":
        return base
    return script.measure(script.with_field_of_paper(name), p, drifting, **options)[quantity].minus(base)


@pytest.mark.parametrize(
    ("name", "p", "quantity", "drifting"),
    [
        ("siemens", 10, "reward", False),
        ("eta_squash", 10, "fatigue", False),
        ("consumption_offset", 10, "reward", False),
        ("drift_rate", 10, "setpoint", True),
        ("drift_rate", 10, "reward", True),
    ],
)
def test_a_number_is_measured_again_with_sign_and_size(script, name, p, quantity, drifting):
    start = "from" if drifting else "p ="
    table = parse(TEXT, script.Sample)[name, f"{quantity}, {start} {p}"]
    again = measured_again(script, name, p, quantity, drifting)
    bound = SIGMAS * math.hypot(table.error, again.error)
    assert abs(again.mean - table.mean) < bound
    for wrong in (0.0, -table.mean, 2 * table.mean):
        assert abs(again.mean - wrong) > bound
