"""The results on the paper's prototypes: tables and text agree with the runs, and samples are made again."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from helpers import ROOT, script

import ibdata
from ibdata.evaluation.baselines import NOTHING, PROTOTYPES, measured, shipped_baselines
from training import formulas, setpoint_map
from training import prototypes_page as page
from training.plan import (
    SOURCES,
    Run,
    plan,
    stages,
)
from training.protocol import EVALUATIONS, LITERATURE
from training.results import Results

LINES = shipped_baselines([PROTOTYPES])
PAGE = (ROOT / "docs/prototypes.md").read_text(encoding="utf-8")
MEASURED = json.loads((ROOT / "docs/prototypes.json").read_text(encoding="utf-8"))


def test_the_page_shows_the_runs():
    for kind, block in page.blocks(LINES).items():
        shown = PAGE.partition(f"<!-- {kind} -->\n")[2].partition(f"\n<!-- /{kind} -->")[0]
        assert shown == f"\n{block}\n", kind


def test_the_tables_beside_the_page_are_those_of_the_runs():
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


@pytest.mark.parametrize("name", ["safe", "transfer", "setpoints/expert"])
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


def test_the_formula_of_complexity_21_is_the_policy_optimized():
    def complexity_21(z):
        last = -3.48 * z(formulas.H, 3) - z(formulas.H, 4) + 2 * z(formulas.P, 0) + 0.81
        return -z(formulas.V, 5) - 0.91, 2 * z(formulas.F, 3) - z(formulas.P, 0) + 1.43, last

    policies = {"formula": formulas.Formula(complexity_21)}
    found = ibdata.evaluate(policies, [10, 70], history=formulas.FRAMES, episodes=5)
    np.testing.assert_allclose(
        found.returns[0], ibdata.evaluate("optimized", [10, 70], episodes=5).returns[0]
    )


def test_distances_of_setpoints_are_found_again(monkeypatch):
    """From one source, with 100 states; their means differ by at most a tenth."""
    monkeypatch.setattr(setpoint_map, "SOURCES", (70,))
    again = setpoint_map.distances(states=100)["consumption"][0]
    stored = MEASURED["distances"]["consumption"][SOURCES.index(70)]
    assert again[3] == stored[3] == 0.0  # at 70 itself
    np.testing.assert_allclose(again, stored, rtol=0.25)


def test_parts_of_a_set_are_named_by_what_is_learned():
    assert stages("100 at 50, then 2 at 75") == ["100 at 50", "2 at 75"]
    assert Run("transfer", "100 at 50 + 2 at 75", "bc", 0).targets() == [75.0]
    assert 75.0 in Run("transfer", "100 at 50", "bc", 0).targets()
    assert 60.0 not in Run("transfer", "100 at 60", "bc", 0).targets()


def test_every_number_of_the_text_is_in_a_table_of_the_page():
    beside = [line for each in MEASURED["tables"].values() for line in each["table"]]
    tables = "\n".join(line for line in [*PAGE.splitlines(), *beside] if line.startswith("|"))
    text = " ".join(line for line in PAGE.splitlines() if not line.startswith("|"))
    for form in (r"−\d+\.\d+", r"\d+\.\d+ ± \d+\.\d+"):
        numbers = re.findall(form, text)
        assert numbers
        assert set(numbers) <= set(re.findall(form, tables))


def test_results_are_asked_by_what_was_learned_from():
    results = Results(LINES)
    known = results.known("random", "random", EVALUATIONS["random"][0])
    assert known.shape == (10, 100)
    assert np.array_equal(known, results.known("random", "behaviour", EVALUATIONS["random"][0]))
    assert results.returns("random", "0 episodes each", "bc", EVALUATIONS["random"][0]) == []
