"""What a view shows, its rewards, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from ibdata.errors import UsageError
from ibdata.views.options import bounds_of, view_options
from ibdata.views.rewards import reward_of


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
    with pytest.raises(UsageError, match=message):
        view_options(**given)


BEFORE = np.array([100.1, 3.0], np.float32), np.array([10.7, 0.5], np.float32)  # consumption, fatigue
AFTER = np.array([90.3, 4.0], np.float32), np.array([12.9, 0.25], np.float32)


@pytest.mark.parametrize("scale", [1.0, 0.01])
def test_weights_are_computed_in_float64_and_rounded_once(scale):
    assert reward_of({"fatigue": 2}).of(BEFORE, AFTER, 1.0).tolist() == (-2 * AFTER[1]).tolist()
    found = reward_of({"consumption": 0.7, "fatigue": 2.2}).of(BEFORE, AFTER, scale)
    exact = [-(0.7 * float(c) + 2.2 * float(f)) * scale for c, f in zip(*AFTER, strict=True)]
    assert found.tolist() == np.array(exact).astype(np.float32).tolist()
    assert found.dtype == np.float32


def test_rewards_that_become_infinite_are_refused():
    with pytest.raises(
        UsageError, match=r"reward: found weights or a scale .1e.300. that make rewards infin"
    ):
        reward_of("delta").of(BEFORE, AFTER, 1e300)
    with np.errstate(all="ignore"), pytest.raises(UsageError, match="that make rewards infinite"):
        reward_of({"consumption": 1e308, "fatigue": -1e308}).of(BEFORE, AFTER, 1.0)  # inf - inf
