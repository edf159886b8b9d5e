"""The table of docs/views.md can be made again, and its text agrees with it."""

from __future__ import annotations

import pytest
from helpers import ROOT, script

from measuring.documents import measured

PAGE = (ROOT / "docs/views.md").read_text(encoding="utf-8")
ROWS = {
    line.split(" | ")[0].strip("| "): line
    for line in measured(PAGE, "measured, costs").split("\n")
    if "`" in line
}
TABLE = {
    name: [float(cell.strip(" |").split(" ± ")[0].replace("−", "-")) for cell in row.split(" | ")[1:]]
    for name, row in ROWS.items()
}
REWARD, FATIGUE, OVER, RUNAWAY, OVER_TOO = ({name: row[i] for name, row in TABLE.items()} for i in range(5))
MIXED = "`optimized`, 80 % random"
COSTS = script("costs")


@pytest.mark.slow
def test_rows_are_made_again():
    some = {name: COSTS.POLICIES[name] for name in ("`mediocre`",)}
    again = COSTS.measured(some, **COSTS.SETTINGS).splitlines()
    assert again[2:] == [ROWS[name] for name in some]
    assert list(ROWS) == list(COSTS.POLICIES)


def test_the_text_agrees_with_the_table():
    assert FATIGUE["`expert`"] * COSTS.SETTINGS["episodes"] == 1
    assert [FATIGUE["`optimized`"], RUNAWAY["`optimized`"], RUNAWAY["`expert`"]] == [0, 0, 0]
    assert {OVER[x] + OVER_TOO[x] for x in TABLE if "optimized" in x and x != MIXED} == {0}
    assert REWARD["`mediocre`"] > REWARD["`random`"]
    assert (OVER["`mediocre`"], FATIGUE["`bad`"]) == (100, 0)
    # A reward is −c − 3 f, and f of `bad` is at most 60.
    assert -REWARD["`bad`"] - 3 * 60 > max(-REWARD[x] for x in TABLE if x != "`bad`")
    assert [FATIGUE["`constant`"], RUNAWAY["`constant`"]] == [0, 0]
    assert REWARD["`constant`"] < REWARD[MIXED]
    assert 13 < OVER[MIXED] < OVER_TOO[MIXED] < 15
    said = "in {:.0f} of 1000 steps, but μ runs away in {:.0f}; under random actions in {:.0f} and {:.0f}."
    numbers = [steps[x] for x in ("`mediocre`", "`random`") for steps in (FATIGUE, RUNAWAY)]
    assert said.format(*numbers) in " ".join(PAGE.split())

    chance = 1 - 0.05 ** (1 / COSTS.SETTINGS["episodes"])
    assert f"is within {100 * chance:.1f} of it, at 95 % confidence" in " ".join(PAGE.split())
