"""Off-policy evaluation and selection: how estimators are measured, and what the page says of them."""

from __future__ import annotations

import itertools
import json
import math
import re

import numpy as np
import pytest
from helpers import ROOT, script

import ibdata
from measuring.documents import measured as tables_of
from training import selecting, selection_page
from training.selecting import ESTIMATORS, Checkpoint, Estimate, Line, plan

FILE = ROOT / "docs" / "policy-selection.jsonl"
LINES = [Line.model_validate_json(line) for line in FILE.read_text(encoding="utf-8").splitlines()]
PAGE = (ROOT / "docs/policy-selection.md").read_text(encoding="utf-8")
FOUR = np.array([-5.0, -1.0, -2.0, -4.0])


def line(one: Checkpoint, value: float = -6000.0, **estimates: float | None) -> Line:
    """A result of a target policy, whose estimates are its value unless given."""
    known = {name: estimates.get(name.replace(" ", "_"), value) for name in ESTIMATORS}
    return Line(
        **one._asdict(),
        sha256="0" * 64,
        content_root="0" * 64,
        value=Estimate(mean_return=value, standard_error=1.0, interval=(value - 2.0, value + 2.0)),
        estimates={name: Estimate(mean_return=mean) for name, mean in known.items()},
        effective={"1": 50.0, "100": 1.0},
        cpu_seconds={"FQE": 10.0},
        versions={},
    )


def test_the_plan_has_twenty_policies_of_each_of_four_sets():
    assert len(set(plan())) == len(plan()) == 80
    assert [sum(one.set == name for one in plan()) for name in selecting.SETS] == [20] * 4
    assert {one.training_steps for one in plan()} == set(selecting.GRID)


def test_shorter_episodes_are_beginnings_of_longer_ones(tmp_path):
    """So importance sampling may use `steps=100`, from which the sets are made again."""

    def made(steps):
        changes = {"episodes": 3, "steps": steps}
        folder = tmp_path / str(steps)
        return ibdata.generate("siemens-offline/bad-60", folder, workers=1, overrides=changes)

    long, short = (made(steps).arrays(history=2) for steps in (60, 20))
    early = long["step"] < 20
    for name in ("observations", "actions", "rewards", "episode"):
        assert np.array_equal(long[name][early], short[name])


def test_the_absolute_error_is_the_mean_distance():
    assert selecting.absolute_error(FOUR, FOUR + np.array([1.0, -3.0, 0.0, 0.0])) == 1.0


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
    assert selecting.rank_correlation(FOUR, np.array(estimates)) == pytest.approx(expected, nan_ok=True)


def test_the_regret_is_what_the_best_chosen_policy_lacks():
    estimates = np.array([4.0, 1.0, 2.0, 3.0])  # chooses -5, then -4, -2, -1
    assert [selecting.regret(FOUR, estimates, k) for k in (1, 2, 3, 4)] == [4.0, 3.0, 1.0, 0.0]
    assert selecting.regret(FOUR, np.zeros(4), 1) == 4.0  # the first


def test_the_regret_of_chance_is_the_mean_over_all_choices():
    for k in (1, 2, 3, 4):
        choices = [FOUR.max() - max(chosen) for chosen in itertools.combinations(FOUR, k)]
        assert selecting.chance_regret(FOUR, k) == pytest.approx(np.mean(choices))


def test_an_interval_is_that_of_resampled_policies():
    draws = np.random.default_rng(3)
    values = draws.normal(size=20)
    estimates = values + draws.normal(size=20)
    found = selecting.measured(values, estimates, selecting.absolute_error)
    assert found.value == selecting.absolute_error(values, estimates)
    errors = np.abs(estimates - values)
    half = 1.96 * errors.std() / math.sqrt(20)
    assert (found.low, found.high) == pytest.approx((errors.mean() - half, errors.mean() + half), abs=0.1)
    sure = selecting.measured(values, values - 3.0, selecting.absolute_error)
    assert sure == pytest.approx((3.0, 3.0, 3.0))
    assert all(map(math.isnan, selecting.measured(values, np.zeros(20), selecting.rank_correlation)))


def test_an_estimator_that_lacks_one_policy_has_no_measures():
    one = [one for one in plan() if one.set == selecting.SETS[0]]
    lines = [line(each, -6000.0 - 10.0 * i) for i, each in enumerate(one)]
    lines[3] = line(one[3], weighted=None)
    assert selecting.estimates_of(lines, "weighted") is None
    rows = {row.split(" | ")[0]: row for row in selection_page.measures(lines).splitlines()}
    assert rows["| weighted IS"] == "| weighted IS | – | – | – | – |"
    assert rows["| FQE"].startswith("| FQE | 0.0 [0.0, 0.0] | 1.00 [1.00, 1.00] | 0.0 ")


def test_intervals_are_counted_that_contain_the_true_value():
    def of(value, interval):
        made = line(plan()[0], value)
        return made.model_copy(update={"estimates": {"FQE": Estimate(mean_return=0.0, interval=interval)}})

    lines = [of(-5.0, (-5.0, 0.0)), of(-5.1, (-5.0, 0.0)), of(1.0, (-5.0, 0.0)), of(0.0, None)]
    assert selection_page.covered(lines, "FQE") == "1 of 3"


def test_a_result_is_said_in_a_line():
    assert script("selection").said(line(plan()[0])) == (
        "value -60.0, per decision -60.0, weighted -60.0, FQE -60.0, model -60.0, in hundreds"
    )


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
    assert tables_of(PAGE) == f"\n{selection_page.block(LINES)}\n"


def test_every_number_of_the_reading_stands_in_the_tables():
    reading = PAGE.partition("## Reading\n")[2].partition("\n## ")[0]
    numbers = re.findall(r"−?\d+\.\d+", reading)
    assert numbers
    assert [number for number in numbers if f" {number}" not in tables_of(PAGE)] == []
