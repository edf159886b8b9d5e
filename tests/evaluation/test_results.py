"""Results of an evaluation: their statistics, differences and scores."""

from __future__ import annotations

import json

import numpy as np
import pytest
from helpers.evaluating import returns

from ibdata import evaluate


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
    assert (found.steps, found.discount) == (30, 0.97)
    assert json.loads(json.dumps(found.plain()))["results"][1]["policy"] == "random"
    assert low.mean_reward == pytest.approx(returns("random", 10.0, episodes=50, discount=1.0).mean() / 30)


def test_policies_of_one_training_each_are_printed_as_results():
    found = evaluate(["safe", "bad"], steps=3, episodes=2)
    assert [table.names[0] for table in found.tables()] == ["policy", "policy"]
    seeds = evaluate({"bc": ["random-bc-0", "random-bc-1"]}, steps=3, episodes=2)
    assert [table.names[0] for table in seeds.tables()] == ["label"]


def test_differences_are_paired_and_of_every_two_policies():
    found = evaluate(["safe", "mediocre", "bad"], [10.0, 70.0], steps=30, episodes=20)
    assert [(d.policy, d.minus, d.setpoint) for d in found.differences] == [
        (policy, minus, p)
        for policy, minus in (("mediocre", "safe"), ("bad", "safe"), ("bad", "mediocre"))
        for p in (10.0, 70.0, None)
    ]
    by_hand = found.returns[2, 1] - found.returns[0, 1]
    difference = found.differences[4]
    assert difference.mean_difference == pytest.approx(by_hand.mean())
    assert difference.standard_error == pytest.approx(by_hand.std(ddof=1) / np.sqrt(20))


SETTINGS = [
    {"setpoint": "drifting"},
    {"dynamics": {"base": "paper", "eta_mean": 0.1}, "start": {"burn_in": [1, 2]}},
]


@pytest.mark.parametrize("settings", SETTINGS)
def test_random_scores_0_and_the_top_100_without_error(settings):
    base = settings.get("dynamics", {"base": "siemens"})["base"]
    expert = {"kind": "expert", "dynamics": base}
    found = evaluate(["random", "safe", "optimized", expert], episodes=30, **settings)
    random, safe, optimized, expert = found.results
    assert (random.score, random.score_error, random.expert_score) == (0.0, 0.0, 0.0)
    assert (optimized.score, optimized.score_error, expert.expert_score) == (100.0, 0.0, 100.0)
    assert safe.score_error > 0.1
    assert found.scale == "0 = random, 100 = optimized, simulated in the same episodes"
    assert "simulated in the same episodes: 100 steps, discount 0.97" in str(found)
    replaced = "this expert is made for paper as published, but here eta_mean = 0.1"
    said = [] if "dynamics" not in settings else [f"expert: {replaced}", f"expert_score: {replaced}"]
    assert found.notes == said
    [alone] = evaluate("safe", episodes=30, **settings).results
    assert alone == safe


def test_a_score_is_a_ratio_of_means_with_its_error():
    """The error is that of the jackknife, computed by leaving out each episode in turn."""
    found = evaluate(["random", "safe", "optimized"], [10.0, 70.0], episodes=40)
    random, safe, optimized = found.returns[:, 1]

    def score(own):
        low = random[own].mean()
        return 100.0 * (safe[own].mean() - low) / (optimized[own].mean() - low)

    every = np.arange(40)
    without = np.array([score(every != i) for i in every])
    low, high, overall = found.results[3:6]
    assert high.score == pytest.approx(score(every))
    assert high.score_error == pytest.approx(np.sqrt(39.0 * without.var()), rel=0.05)
    assert overall.score == pytest.approx((low.score + high.score) / 2.0)
    assert overall.score_error == pytest.approx(np.hypot(low.score_error, high.score_error) / 2.0)


@pytest.mark.parametrize(
    ("arguments", "notes"),
    [
        ({}, []),
        ({"episodes": 1}, ["no standard error: one episode per policy and setpoint has none"]),
        (
            {"setpoint": [50, 100], "steps": 3},
            [
                "no score at setpoint 100, and so none over all setpoints: "
                "optimized is not clearly better than random in these episodes"
            ],
        ),
    ],
)
def test_what_is_missing_has_a_reason(arguments, notes):
    found = evaluate("constant", **{"episodes": 20, **arguments})
    assert found.notes == notes
    missing = any(None in (r.score, r.score_error, r.standard_error) for r in found.results)
    assert missing == bool(notes)
