"""Results of an evaluation: their statistics, differences and scores."""

from __future__ import annotations

import json

import numpy as np
import pytest
from helpers.evaluating import returns

from ibdata import evaluate
from ibdata.dataset.reference_returns import scale

FEW_STEPS = {"burn_in": [1, 2]}


def test_the_statistics_are_those_of_the_returns():
    found = evaluate("random", [10.0, 70.0], steps=30, episodes=50)
    low, high, overall = found.results
    for result, values in ((low, found.returns[0, 0]), (high, found.returns[0, 1])):
        error = values.std(ddof=1) / np.sqrt(50)
        assert result.mean_return == pytest.approx(values.mean(), rel=1e-14)
        assert result.standard_error == pytest.approx(error, rel=1e-12)
        # Student's t with 49 degrees of freedom: 2.009575
        half = 2.009575 * error
        assert result.interval == pytest.approx((values.mean() - half, values.mean() + half), rel=1e-6)
        assert result.p10 == np.quantile(values, 0.1)
    assert (low.setpoint, high.setpoint, overall.setpoint) == (10.0, 70.0, None)
    assert overall.mean_return == pytest.approx((low.mean_return + high.mean_return) / 2.0)
    assert overall.standard_error == pytest.approx(np.hypot(low.standard_error, high.standard_error) / 2.0)
    assert overall.p10 == np.quantile(found.returns, 0.1)
    assert (low.episodes, overall.episodes) == (50, 100)
    assert low.mean_reward == pytest.approx(returns("random", 10.0, episodes=50, discount=1.0).mean() / 30)


def test_differences_are_paired_and_of_every_two_policies():
    found = evaluate(["safe", "mediocre", "bad"], [10.0, 70.0], steps=30, episodes=20)
    assert [(d.policy, d.less, d.setpoint) for d in found.differences] == [
        (policy, less, p)
        for policy, less in (("mediocre", "safe"), ("bad", "safe"), ("bad", "mediocre"))
        for p in (10.0, 70.0, None)
    ]
    by_hand = found.returns[2, 1] - found.returns[0, 1]
    difference = found.differences[4]
    assert difference.mean_difference == pytest.approx(by_hand.mean())
    assert difference.standard_error == pytest.approx(by_hand.std(ddof=1) / np.sqrt(20))


def test_one_episode_has_no_standard_error():
    [result] = evaluate("random", steps=5, episodes=1).results
    assert result.standard_error is result.interval is None


def test_the_score_is_that_of_the_scale_where_there_is_one():
    found = evaluate(["optimized", "mediocre"], [70.0, 50.0])
    assert [r.score for r in found.results[:3]] == pytest.approx([100.0] * 3, abs=2.0)
    assert all(r.score < 0.0 for r in found.results[3:])
    assert found.results[2].score == (found.results[0].score + found.results[1].score) / 2.0
    assert found.scale.startswith("0 = random, 100 = optimized, or expert for the expert score, at the same")
    for other in ({"steps": 99}, {"discount": 1.0}, {"start": FEW_STEPS}, {"dynamics": {"base": "paper"}}):
        unscaled = evaluate("optimized", **{"episodes": 2, **other})
        assert (unscaled.scale, unscaled.results[0].score) == (None, None)
    assert [r.score for r in evaluate("optimized", [70.0, 71.0], episodes=2).results][1:] == [None, None]


@pytest.mark.parametrize("start", ["uniform", {"burn_in": [15, 64]}], ids=str)
def test_the_score_is_that_of_the_start(start):
    found, known = evaluate("optimized", 75.0, start=start), scale("siemens", start, 100, 0.97)
    assert found.results[0].score == known.score(75.0, found.results[0].mean_return)
    assert found.scale == known.text


def test_the_error_of_a_score_is_that_of_its_return_on_the_scale():
    low, high, overall = evaluate("safe", [10.0, 70.0], episodes=10).results
    for r in (low, high):
        [other] = evaluate("optimized", r.setpoint, episodes=2).results
        slope = (other.score - r.score) / (other.mean_return - r.mean_return)
        assert r.score_error == pytest.approx(slope * r.standard_error)
    assert overall.score_error == pytest.approx(np.hypot(low.score_error, high.score_error) / 2.0)


@pytest.mark.parametrize(
    ("arguments", "notes"),
    [
        ({}, []),
        ({"episodes": 1}, ["no standard error: one episode per policy and setpoint has none"]),
        ({"setpoint": "drifting"}, ["no score: drifting setpoints have none"]),
        (
            {"steps": 7},
            [
                "no score: there are reference returns only for the dynamics siemens, paper; the starts "
                "default, uniform, {burn_in: [15, 64]}; 100 steps with discount 0.97, 1000 steps with "
                "discount 1"
            ],
        ),
        (
            {"setpoint": [71, 70]},
            [
                "no score at setpoint 71, and so none over all setpoints: there are reference returns at "
                "0, 5, 10, 15, 20, 25, 30, 35, 40, 45, 50, 55, 60, 65, 70, 75, 80, 85, 90, 95, 100"
            ],
        ),
    ],
)
def test_what_is_missing_has_a_reason(arguments, notes):
    found = evaluate("constant", **{"episodes": 2, **arguments})
    assert found.notes == notes
    missing = any(None in (r.score, r.score_error, r.standard_error) for r in found.results)
    assert missing == bool(notes)


def test_steps_and_discount_are_told():
    found = evaluate("constant", steps=3, episodes=2, discount=0.5)
    assert (found.steps, found.discount, found.results[0].episodes) == (3, 0.5, 2)


def test_clipped_actions_are_counted_by_policy_and_setpoint():
    def rising(seen):  # beyond 1 at the setpoint 70 only, for every second episode
        return np.where((seen[:, :1] > 50) & (np.arange(len(seen))[:, None] % 2 == 0), 1.5, 1.0) * np.ones(3)

    found = evaluate({"rising": rising, "still": "constant"}, [10.0, 70.0], steps=3, episodes=4)
    assert [r.clipped for r in found.results] == [0.0, 0.5, 0.25, 0.0, 0.0, 0.0]


def test_plain_is_json():
    plain = evaluate(["random", "safe"], episodes=3, steps=5).plain()
    assert json.loads(json.dumps(plain))["results"][1]["policy"] == "safe"


def test_a_moving_setpoint_begins_where_it_says_and_has_no_score():
    one, two = (evaluate("safe", p, episodes=20) for p in ("drifting", {"drifting": [50, 80]}))
    assert [result.setpoint for result in two.results] == [50.0, 80.0, None]
    assert one.results[0] == two.results[0]
    assert evaluate("safe", 50, episodes=20).results[0].mean_return != one.results[0].mean_return
    assert {result.score for result in (*one.results, *two.results)} == {None}
    assert (one.scale, two.scale) == (None, None)
