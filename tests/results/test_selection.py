"""Off-policy evaluation and selection: how estimators are measured, and what the page says of them."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from helpers import ROOT

from measuring.documents import measured as tables_of
from training import selection
from training.selection import ESTIMATORS, Line, plan

FILE = ROOT / "studies" / "policy-selection.jsonl"
LINES = [Line.model_validate_json(line) for line in FILE.read_text(encoding="utf-8").splitlines()]
PAGE = (ROOT / "studies/selection.md").read_text(encoding="utf-8")
TABLES = tables_of(PAGE, "measured, selection")
FOUR = np.array([-5.0, -1.0, -2.0, -4.0])


@pytest.mark.parametrize(
    ("estimates", "expected"),
    [
        ([-50.0, -10.0, -20.0, -40.0], 1.0),
        ([5.0, 1.0, 2.0, 4.0], -1.0),
        ([1.0, 3.0, 4.0, 2.0], 0.8),  # 1 - 6 Σd²/(n (n² - 1)), d = 0, 1, 1, 0
        ([1.0, 2.0, 2.0, 2.0], math.sqrt(0.6)),  # ranks 1, 3, 3, 3
        ([7.0, 7.0, 7.0, 7.0], math.nan),
    ],
)
def test_the_rank_correlation_is_spearmans(estimates, expected):
    assert selection.rank_correlation(FOUR, np.array(estimates)) == pytest.approx(expected, nan_ok=True)


def test_the_shipped_results_are_those_of_the_plan_in_its_order():
    keys = [each.key for each in LINES]
    assert keys == [one for one in plan() if one in set(keys)]
    assert len({each.sha256 for each in LINES}) == len(LINES) > 0
    for each in LINES:
        low, high = each.value.interval
        assert low < each.value.mean_return < high
        assert list(each.estimates) == list(ESTIMATORS)
        assert json.loads(each.model_dump_json())["estimates"]["FQE"]["mean_return"] is not None


@pytest.mark.slow
def test_the_page_holds_the_shipped_results():
    assert f"\n{selection.shown(LINES)}\n" == TABLES
    beside = json.loads(FILE.with_suffix(".json").read_text(encoding="utf-8"))
    assert selection.block(LINES).splitlines() == beside
