"""The reference returns are those of the policies, and give the scale of the scores."""

from __future__ import annotations

import math

import pytest

from ibdata import evaluate
from ibdata.dataset.reference_returns import Measured, Scale, reference, scale

POLICIES = ["zero", "random", "safe", "mediocre", "optimized"]
SETTINGS = [("siemens", 100, 0.97), ("siemens", 1000, 1.0), ("paper", 100, 0.97), ("paper", 1000, 1.0)]
BLOCKS = {"zero": {"kind": "constant", "name": "zero"}}


def row(dynamics, steps, discount, policy, setpoint):
    results = scale(dynamics, "default", steps, discount).results
    return next(r for r in results if (r.policy, r.setpoint) == (policy, setpoint))


@pytest.mark.parametrize(("dynamics", "steps", "discount"), SETTINGS)
def test_every_policy_has_a_return_at_every_setpoint(dynamics, steps, discount):
    results = scale(dynamics, "default", steps, discount).results
    found = [(r.policy, r.setpoint) for r in results]
    assert found == [(policy, 10.0 * i) for policy in POLICIES for i in range(11)]
    for r in results:
        low, high = r.interval
        assert low < r.mean_return < high
        assert 0.0 < r.standard_error < 0.01 * abs(r.mean_return)
        assert r.mean_return < r.mean_reward < 0.0


@pytest.mark.parametrize(
    ("dynamics", "steps", "discount", "policy", "setpoint"),
    [
        ("siemens", 100, 0.97, "optimized", 70.0),
        ("siemens", 1000, 1.0, "random", 70.0),
        ("paper", 100, 0.97, "safe", 30.0),
        ("paper", 1000, 1.0, "zero", 100.0),
    ],
)
def test_the_file_is_as_measured(dynamics, steps, discount, policy, setpoint):
    stored = row(dynamics, steps, discount, policy, setpoint)
    episodes = scale(dynamics, "default", steps, discount).episodes
    [found] = evaluate(
        BLOCKS.get(policy, policy),
        setpoint,
        dynamics=dynamics,
        steps=steps,
        discount=discount,
        episodes=episodes,
    ).results
    for name in ("mean_return", "standard_error", "p10", "mean_reward"):
        assert getattr(found, name) == pytest.approx(getattr(stored, name), rel=1e-9)
    assert found.interval == pytest.approx(stored.interval, rel=1e-9)


@pytest.mark.parametrize("policy", POLICIES)
def test_other_random_numbers_give_the_same_returns(policy):
    """Within 5 standard errors of both; a return that is wrong by 10 of them (below 2 %) would show."""
    for setpoint in (0.0, 40.0, 100.0):
        stored = row("siemens", 100, 0.97, policy, setpoint)
        [found] = evaluate(BLOCKS.get(policy, policy), setpoint, episodes=400, seed=1).results
        error = math.hypot(stored.standard_error, found.standard_error)
        assert found.mean_return == pytest.approx(stored.mean_return, abs=5 * error)


def test_the_ends_of_the_scale_are_0_and_100():
    for settings in SETTINGS:
        dynamics, steps, discount = settings
        made = scale(dynamics, "default", steps, discount)
        for setpoint in (10.0 * i for i in range(11)):
            ends = [row(*settings, policy, setpoint).mean_return for policy in ("random", "optimized")]
            found = [made.score(setpoint, x) for x in ends]
            assert found == [None, None] or found == pytest.approx([0.0, 100.0])
    assert scale("siemens", "default", 100, 0.97).score(
        70.0, row(*SETTINGS[0], "optimized", 70.0).mean_return
    )


def made_up(low, high, error):
    rows = [
        Measured.model_construct(policy=policy, setpoint=70.0, mean_return=x, standard_error=error)
        for policy, x in (("random", low), ("optimized", high))
    ]
    return Scale.model_construct(results=rows)


def test_a_score_needs_ends_that_are_five_standard_errors_apart():
    # √(3² + 3²) · 5 = 21.2
    assert made_up(-120.0, -98.0, 3.0).score(70.0, -109.0) == 50.0
    assert made_up(-120.0, -99.0, 3.0).score(70.0, -109.0) is None
    assert made_up(-98.0, -120.0, 0.1).score(70.0, -109.0) is None
    assert made_up(-120.0, -98.0, 3.0).score(71.0, -109.0) is None


@pytest.mark.parametrize(
    "settings",
    [
        ("siemens", "uniform", 100, 0.97),
        ("siemens", {"burn_in": [1, 2]}, 100, 0.97),
        ("siemens", "default", 100, 1.0),
        ("siemens", "default", 1000, 0.97),
        ({"base": "siemens"}, "default", 100, 0.97),
        ("siemens", None, 100, 0.97),
    ],
    ids=str,
)
def test_only_equal_things_are_compared(settings):
    assert scale(*settings) is None


def test_the_file_says_how_it_was_made():
    assert reference().made_by == "scripts/reference-returns"
