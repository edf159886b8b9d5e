"""Views: what they show, what they cost, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.refusals import refused

import ibdata
from ibdata.errors import UsageError
from ibdata.views.options import bounds_of, view_options
from ibdata.views.rewards import cost_of, reward_of


def test_a_frame_has_columns_then_flags_then_the_actions_before():
    imperfections = {"missing": {"obs_gain": 0.1}, "delay": {"obs_velocity": 1}, "mask": True}
    options = view_options(["obs_gain", "obs_velocity"], True, imperfections=imperfections)
    assert view_options(iter(["obs_gain", "obs_velocity"])) == view_options(["obs_gain", "obs_velocity"])
    assert options.frame(drifting=False) == (
        *("obs_gain", "obs_velocity", "missing_obs_gain"),
        *("previous_act_velocity", "previous_act_gain", "previous_act_shift"),
    )


def test_bounds_are_those_of_exact_columns():
    imperfections = {"noise": {"obs_velocity": 1.0}, "missing": {"obs_gain": 0.5}, "mask": True}
    options = view_options(["obs_velocity", "obs_gain", "latent_mu_v"], True, imperfections=imperfections)
    assert bounds_of(options, False) == [(None, None), (0, 100), (0, 5), (0, 1), *[(-1, 1)] * 3]
    assert bounds_of(view_options(), False, (-7.0, 9.0))[-1] == (-7.0, 9.0)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"observe": "makrov"}, "observe: found 'makrov', expected classic, markov .* did you mean 'markov'"),
        ({"observe": ["obs_gian"]}, "found 'obs_gian', expected columns .* did you mean 'obs_gain'"),
        ({"observe": ["reward"]}, "observe: found 'reward', expected columns obs_… or latent_…"),
        ({"actions": "yes"}, "actions: found 'yes', expected True or False"),
        ({"reward_scale": 0}, "reward_scale: found 0, expected a finite number above 0"),
        ({"reward": "detla"}, "reward: found 'detla', expected classic, delta .* did you mean 'delta'"),
        ({"reward": {"fatique": 1}}, "found 'fatique', expected weights .* did you mean 'fatigue'"),
        ({"reward": {"fatigue": float("nan")}}, "reward: fatigue: found nan, expected a finite number"),
        ({"imperfections": {"dealy": {}}}, "imperfections: dealy: no such option; did you mean 'delay'"),
        ({"imperfections": {"delay": {"obs_gain": 1.5}}}, "obs_gain: found 1.5, expected a whole number"),
        ({"imperfections": {"noise": {"obs_gain": -1}}}, "found -1, expected a standard deviation above 0"),
        ({"imperfections": {"missing": {"obs_gain": 2}}}, "found 2, expected a probability"),
        ({"imperfections": {"mask": 1}}, "imperfections: mask: found 1, expected True or False"),
        ({"imperfections": {"seed": -1}}, "imperfections: seed: found -1, expected a whole number"),
        (
            {"observe": ["obs_gain"], "imperfections": {"delay": {"obs_velocity": 1}}},
            "imperfections: found 'obs_velocity', expected one of the observed columns",
        ),
    ],
)
def test_what_is_no_view_is_refused(given, message):
    refused(message, view_options, **given)


BEFORE = np.array([100.1, 3.0], np.float32), np.array([10.7, 0.5], np.float32)  # consumption, fatigue
AFTER = np.array([90.3, 4.0], np.float32), np.array([12.9, 0.25], np.float32)


def test_rewards_that_become_infinite_are_refused():
    with pytest.raises(
        UsageError, match=r"reward: found weights or a scale .1e.300. that make rewards infin"
    ):
        reward_of("delta").of(BEFORE, AFTER, 1e300)
    with np.errstate(all="ignore"), pytest.raises(UsageError, match="that make rewards infinite"):
        reward_of({"consumption": 1e308, "fatigue": -1e308}).of(BEFORE, AFTER, 1.0)  # inf - inf


@pytest.mark.parametrize(("cost", "expected"), [({"fatigue": 1.2}, [0, 0, 1]), ("runaway", [0, 1, 1])])
def test_a_fatigue_at_its_limit_costs_nothing_and_a_hidden_state_at_1_2_does(cost, expected):
    around = np.nextafter(np.float32(1.2), [np.float32(0), np.float32(1.2), np.float32(2)])
    assert cost_of(cost).of([around]).tolist() == expected


def test_an_evaluation_counts_steps_that_cost_and_episodes_over_the_budget():
    """A limit of 0 is exceeded at each step, one of 300 never."""
    for limit, budget, expected in ((0, 0, (8, 1)), (0, 7, (8, 1)), (0, 8, (8, 0)), (300, 0, (0, 0))):
        view = {"cost": {"fatigue": limit, "budget": budget}}
        [result] = ibdata.evaluate("random", steps=8, episodes=5, view=view).results
        assert (result.mean_cost, result.cost_error, result.violations) == (expected[0], 0, expected[1])
    assert result.mean_return == ibdata.evaluate("random", steps=8, episodes=5).results[0].mean_return
    assert "mean_cost" in repr(ibdata.evaluate("random", steps=8, episodes=5, view=view))
    assert "mean_cost" not in repr(ibdata.evaluate("random", steps=8, episodes=5))


@pytest.mark.parametrize(
    ("cost", "message"),
    [
        ("runway", "found 'runway', .*; did you mean 'runaway'"),
        ({"fatige": 60}, r"found \{'fatige': 60\}, expected \{fatigue: 60\}, runaway"),
        ({"fatigue": 60, "runaway": True}, "expected {fatigue: 60}, runaway"),
        ({"budget": 3}, "expected {fatigue: 60}"),
        ({}, "expected {fatigue: 60}"),
        ({"fatigue": -1}, "cost: fatigue: found -1, expected a finite number of at least 0"),
        ({"fatigue": 60, "budget": float("nan")}, "cost: budget: found nan, expected a finite number"),
        ({"runaway": True, "budget": True}, "cost: budget: found True"),
        (3, "cost: found 3, expected"),
    ],
)
def test_a_wrong_cost_is_one_line(cost, message):
    refused(message, cost_of, cost)
