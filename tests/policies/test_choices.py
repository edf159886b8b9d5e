"""Policies that repeat, mix and switch others. `test_recount` counts how often."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.policies import distribution, played, playing

from ibdata.policies import POLICIES
from ibdata.policies.checked import ask
from ibdata.policies.distributions import applied

Sticky, Mixture, Schedule = (POLICIES[kind] for kind in ("sticky", "mixture", "schedule"))
UP = {"kind": "constant", "action": [0.5, 0.5, 0.5]}
DOWN = {"kind": "constant", "action": [-0.5, -0.5, -0.5]}
N = 2000


def test_at_the_first_step_there_is_nothing_to_repeat():
    policy = Sticky(base=UP, kappa=1.0)
    assert (played(policy, 4, 3) == 0.5).all()
    first, second = (given for given, _ in playing(policy, 4, 2))
    up = np.full((4, 3), 0.5, np.float32)
    for given in (first, second):  # where the base takes the last action too, the probabilities add
        assert distribution(policy, given).log_density(up).tolist() == [0.0] * 4


@pytest.mark.parametrize(("weights", "share"), [(None, 0.5), ([1.0, 3.0], 0.25)])
def test_one_policy_of_a_mixture_acts_in_a_whole_episode(weights, share):
    action = played(Mixture(bases=[UP, DOWN], weights=weights), N, 3)
    assert (action == action[:, :1, :1]).all()
    assert (action[:, 0, 0] == 0.5).mean() == pytest.approx(share, abs=0.06)


def test_every_policy_of_a_mixture_acts_as_it_would_alone():
    bases = [{"kind": "prbs"}, {"kind": "ornstein_uhlenbeck"}, {"kind": "optimized"}]
    mixture = Mixture(bases=bases)
    steps = list(playing(mixture, 60, 8))
    which = mixture.chosen(steps[0][0])
    assert set(which.tolist()) == {0, 1, 2}
    for number, block in enumerate(bases):
        alone, mine = POLICIES[block["kind"]](), which == number
        memory = np.zeros((60, alone.needs.memory))
        for given, action in steps:
            # One draw of an episode chooses the policy; the next is that of prbs, which alone needs any.
            own = given._replace(episode_draws=given.episode_draws[:, 1:], memory=memory).cut(alone.needs)
            one, memory = ask(alone, own)
            np.testing.assert_array_equal(action[mine], applied(one.sample(own.draws))[mine])
            density, found = one.log_density(action), distribution(mixture, given).log_density(action)
            np.testing.assert_array_equal(found[mine], density[mine])


def test_the_stages_of_a_schedule_follow_one_another():
    stages = [{"base": UP, "steps": 2}, {"base": DOWN, "steps": 3}, {"base": UP}]
    action = played(Schedule(stages=stages), 2, 8)
    assert action[0, :, 0].tolist() == [0.5, 0.5, -0.5, -0.5, -0.5, 0.5, 0.5, 0.5]


def test_a_stage_begins_as_an_episode_does():
    """With zero memory: the variance of the second process is again that of its first step, σ²."""
    noise = {"kind": "ornstein_uhlenbeck", "theta": 0.1, "sigma": 0.1}
    action = played(Schedule(stages=[{"base": noise, "steps": 9}, {"base": noise}]), N, 10)
    assert action[:, 8].std() > 0.2
    assert action[:, 9].std() == pytest.approx(0.1, rel=0.06)


@pytest.mark.parametrize(
    ("stages", "shares"),
    [
        ([{"base": UP, "steps": 3, "epsilon": [1.0, 0.5]}, {"base": UP}], [1.0, 0.75, 0.5, 0.0]),
        ([{"base": UP, "steps": 2, "epsilon": [1.0, 0.25]}], [1.0, 0.25, 0.25, 0.25]),
    ],
    ids=["linear", "the last share lasts"],
)
def test_a_share_of_random_actions_changes_with_the_step(stages, shares):
    policy = Schedule(stages=stages)
    for (given, action), epsilon in zip(playing(policy, N, len(shares)), shares, strict=True):
        assert policy.epsilon(given).tolist() == pytest.approx([epsilon] * N)
        assert (action != 0.5).any(axis=1).mean() == pytest.approx(epsilon, abs=0.07)
