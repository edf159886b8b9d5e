"""The results on the paper's prototypes: tables and text agree with the runs, and samples are made again."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from helpers import ROOT, script

from ibdata.evaluation.baselines import NOTHING, PROTOTYPES, measured, shipped_baselines
from training import formulas
from training import prototypes_page as page
from training.plan import Run, plan
from training.protocol import EVALUATIONS, LITERATURE

LINES = shipped_baselines([PROTOTYPES])
PAGE = (ROOT / "docs/prototypes.md").read_text(encoding="utf-8")
MEASURED = json.loads((ROOT / "docs/prototypes.json").read_text(encoding="utf-8"))


def test_the_page_and_the_tables_beside_it_show_the_runs():
    for kind, block in page.blocks(LINES).items():
        shown = PAGE.partition(f"<!-- {kind} -->\n")[2].partition(f"\n<!-- /{kind} -->")[0]
        assert shown == f"\n{block}\n", kind
    assert page.beside(LINES, MEASURED) == MEASURED["tables"]


def test_the_runs_are_those_of_the_plan_in_its_order():
    keys = [Run(*line.key) for line in LINES]
    assert keys == [run for run in plan() if run in set(keys)]
    for line in LINES:
        for evaluated in line.evaluations:
            assert evaluated == measured(evaluated.settings, evaluated.values, evaluated.failure)
        expected = EVALUATIONS[line.set]
        if line.set == "transfer" and line.trained_on != NOTHING:
            targets = Run(*line.key).targets()
            expected = [] if line.algorithm == "model" else [{**LITERATURE, "setpoint": p} for p in targets]
        assert [evaluated.settings for evaluated in line.evaluations] == expected


@pytest.mark.parametrize(
    "name", ["transfer", *(pytest.param(x, marks=pytest.mark.slow) for x in ("safe", "setpoints/expert"))]
)
def test_the_behaviour_is_played_again_with_the_same_returns(name):
    [shipped] = [line for line in LINES if (line.set, line.algorithm) == (name, "behaviour")]
    again = script("prototypes").known(Run(name, NOTHING, "behaviour", None))
    assert again.evaluations == shipped.evaluations


def test_the_formulas_have_their_returns_in_fewer_episodes():
    """100 episodes each. A difference of 5 standard errors happens once in a million."""
    again = formulas.measure(episodes=100)
    for row, stored in zip(again, MEASURED["formulas"], strict=True):
        assert row["policy"] == stored["policy"]
        for value, error in (("return", "error"), ("difference", "difference_error")):
            assert abs(row[value] - stored[value]) <= 5 * np.hypot(row[error], stored[error])
    published = {row["policy"]: row["return"] for row in MEASURED["formulas"]}
    assert published["21"] > published["29"] > published["27"]


def test_every_number_of_the_text_is_in_a_table_of_the_page():
    beside = [line for each in MEASURED["tables"].values() for line in each["table"]]
    tables = "\n".join(line for line in [*PAGE.splitlines(), *beside] if line.startswith("|"))
    text = " ".join(line for line in PAGE.splitlines() if not line.startswith("|"))
    for form in (r"−\d+\.\d+", r"\d+\.\d+ ± \d+\.\d+"):
        numbers = re.findall(form, text)
        assert numbers
        assert set(numbers) <= set(re.findall(form, tables))
