"""docs/errata.md agrees with the code that it describes, and its tables with a smaller measurement.

The tables hold means over 10,000 episodes with seed 0. Here some are measured again over fewer episodes with
another, fixed seed. Bounds are 5 standard errors of the difference, which exceeds them by chance in 6e-7 of
cases.
"""

from __future__ import annotations

import math
import re
from fractions import Fraction

import numpy as np
import pytest
from helpers import ROOT
from helpers import script as load

from ibdata.dynamics import PAPER, SIEMENS, variants
from ibdata.dynamics.consumption import PENALTY_WEIGHT, operational_cost
from ibdata.dynamics.miscalibration import ALPHA, BETA, SAFE_ZONE, penalty

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


def rho_effect(he):
    """The consumption at φ = 0 minus that with the printed ϱ, by which ω is hᵉ."""
    return PENALTY_WEIGHT * (penalty(0, he) - (BETA * he**4 - ALPHA * he**2))


@pytest.mark.parametrize(
    ("printed", "value"),
    [
        ("mean 0.0498", np.tanh(-0.05 * np.log((np.arange(100_000) + 0.5) / 100_000)).mean()),
        ("1.196 at n = 12", 5 / 3 * (1 - 0.9**12)),
        ("1.243 at n = 13", 5 / 3 * (1 - 0.9**13)),
        ("= 15.0 steps", math.log(5 / 1.2) / math.log(1.1)),
        ("≈ 0.1294", SAFE_ZONE),
        ("0.1309 is 15° in radians, halved", math.radians(15) / 2),
        ("≈ 4915", operational_cost(100.0, 100.0, 100.0)),
        ("exactly 0.99999 times", sum(SIEMENS.convolution_weights)),
        ("is 2.25 in the code", 1 + SIEMENS.consumption_noise * 250),
        ("and 6 in the paper", 1 + PAPER.consumption_noise * 250),
        ("adds 0.125 to", 25 * SIEMENS.consumption_noise),
        ("−2.96 at the edge of the safe zone", rho_effect(SAFE_ZONE)),
        ("−6.36 at hᵉ = 2z", rho_effect(2 * SAFE_ZONE)),
        ("+3.26 at hᵉ = 1.5", rho_effect(1.5)),
    ],
)
def test_a_number_of_the_prose_is_what_the_code_computes(printed, value):
    assert re.sub(r"\s+", " ", TEXT).count(printed) == 1
    digits = re.search(r"[−+]?\d+(?:\.(\d+))?", printed)
    assert round(float(value), len(digits[1] or "")) == float(digits[0].replace("−", "-"))


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
