"""Policies that repeat, mix and switch others."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.playing import played, playing

from ibdata.errors import ConfigError
from ibdata.experiment import Experiment, load
from ibdata.policies import POLICIES

Sticky, Mixture, Schedule = (POLICIES[kind] for kind in ("sticky", "mixture", "schedule"))
UP = {"kind": "constant", "action": [0.5, 0.5, 0.5]}
DOWN = {"kind": "constant", "action": [-0.5, -0.5, -0.5]}
N = 2000


def log_density(policy, given, action):
    return policy.log_density(given, np.tile(np.float32(action), (len(given.step), 1)))


def test_the_last_action_is_repeated_as_often_as_kappa_says():
    action = played(Sticky(base={"kind": "random"}, kappa=0.75), N, 12)
    same = (action[:, 1:] == action[:, :-1]).all(axis=2)
    assert same.mean() == pytest.approx(0.75, abs=0.018)  # six standard errors of 22,000 draws
    assert (same == (action[:, 1:] == action[:, :-1]).any(axis=2)).all()


def test_the_first_action_is_the_bases():
    assert (played(Sticky(base=UP, kappa=1.0), 3, 5) == 0.5).all()


def test_the_density_of_a_sticky_policy_has_a_mass_at_its_last_action():
    policy = Sticky(base={"kind": "random"}, kappa=0.75)
    (first, _), (given, _) = playing(policy, 4, 2)
    last = given.actions[:, 0]
    assert policy.log_density(given, last) == pytest.approx([np.log(0.75)] * 4)
    assert log_density(policy, given, [0.1, 0.2, 0.3]) == pytest.approx([np.log(0.25 / 8)] * 4)
    assert log_density(policy, first, [0.1, 0.2, 0.3]) == pytest.approx([np.log(1 / 8)] * 4)


def test_where_the_base_takes_the_last_action_too_the_probabilities_add():
    policy = Sticky(base=UP, kappa=0.75)
    _, (given, _) = playing(policy, 4, 2)
    assert log_density(policy, given, [0.5] * 3) == pytest.approx([0.0] * 4)
    greedy = Sticky(base={"kind": "epsilon_greedy", "base": UP, "epsilon": 0.2}, kappa=0.75)
    given = given._replace(uniforms=np.zeros((4, greedy.needs.step_draws)))
    assert log_density(greedy, given, [0.5] * 3) == pytest.approx([np.log(0.75 + 0.25 * 0.8)] * 4)
    always = Sticky(base={"kind": "epsilon_greedy", "base": UP, "epsilon": 1.0}, kappa=0.75)
    assert log_density(always, given, [0.5] * 3) == pytest.approx([np.log(0.75)] * 4)


def test_a_custom_base_leaves_no_density():
    policy = Sticky(base={"kind": "custom", "target": "ibdata.policies.bad:Bad"}, kappa=0.5)
    (given, action), *_ = playing(policy, 4, 1)
    assert np.isnan(policy.log_density(given, action)).all()


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
        alone, first = POLICIES[block["kind"]](), [1, 2, 2][number]
        memory = np.zeros((60, alone.needs.memory))
        for given, action in steps:
            own = given._replace(
                observations=given.observations[:, : alone.needs.history],
                uniforms=given.uniforms[:, : alone.needs.step_draws],
                episode_uniforms=given.episode_uniforms[:, first : first + alone.needs.episode_draws],
                memory=memory,
            )
            answer = alone.decide(own)
            memory = answer.memory
            expected = np.clip(np.asarray(answer.actions), -1.0, 1.0).astype(np.float32)
            np.testing.assert_array_equal(action[which == number], expected[which == number])
            density, found = alone.log_density(own, action), mixture.log_density(given, action)
            np.testing.assert_array_equal(found[which == number], density[which == number])


def test_the_stages_of_a_schedule_follow_one_another():
    action = played(
        Schedule(stages=[{"base": UP, "steps": 2}, {"base": DOWN, "steps": 3}, {"base": UP}]), 2, 8
    )
    assert action[0, :, 0].tolist() == [0.5, 0.5, -0.5, -0.5, -0.5, 0.5, 0.5, 0.5]


def test_a_stage_begins_as_an_episode_does():
    """With zero memory: the variance of the second process is again that of its first step, σ²."""
    noise = {"kind": "ornstein_uhlenbeck", "theta": 0.1, "sigma": 0.1}
    action = played(Schedule(stages=[{"base": noise, "steps": 9}, {"base": noise}]), N, 10)
    assert action[:, 8].std() > 0.2
    assert action[:, 9].std() == pytest.approx(0.1, rel=0.06)


def test_the_share_of_random_actions_changes_linearly_with_the_step():
    policy = Schedule(stages=[{"base": UP, "steps": 5, "epsilon": [1.0, 0.5]}, {"base": DOWN}])
    questions = list(playing(policy, N, 7))
    expected = [1.0, 0.875, 0.75, 0.625, 0.5, 0.0, 0.0]
    for (given, action), epsilon in zip(questions, expected, strict=True):
        base = 0.5 if given.step[0] < 5 else -0.5
        assert policy.epsilon(given) == pytest.approx([epsilon] * N)
        assert (action != base).any(axis=1).mean() == pytest.approx(epsilon, abs=0.07)
        if 0.0 < epsilon < 1.0:
            assert log_density(policy, given, [base] * 3) == pytest.approx([np.log(1.0 - epsilon)] * N)
            assert log_density(policy, given, [0.1] * 3) == pytest.approx([np.log(epsilon / 8)] * N)
    assert log_density(policy, questions[0][0], [0.5] * 3) == pytest.approx([np.log(1 / 8)] * N)
    assert log_density(policy, questions[6][0], [0.5] * 3).tolist() == [-np.inf] * N


def test_the_last_share_lasts_to_the_end_of_the_episode():
    policy = Schedule(stages=[{"base": UP, "steps": 2, "epsilon": [1.0, 0.25]}])
    assert [policy.epsilon(given)[0] for given, _ in playing(policy, 1, 4)] == [1.0, 0.25, 0.25, 0.25]


def experiment(text):
    return f"name: x\nsetpoints: 70\npolicies:\n{text}"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "  - {kind: mixture, bases: [{kind: random}], weights: [1.0, 2.0]}",
            "x.yaml:4:5: policies.0: found 2 weights, expected 1, one for each of the bases",
        ),
        (
            "  - {kind: schedule, stages: [{base: {kind: bad}}, {base: {kind: random}}]}",
            "x.yaml:4:5: policies.0: stages.0.steps: found none, expected the number of steps of this stage",
        ),
        (
            "  - {kind: schedule, stages: [{base: {kind: bad}, epsilon: [1.0, 0.0]}]}",
            "x.yaml:4:5: policies.0: stages.0.steps: found none, expected the number of steps of this stage",
        ),
        (
            "  - {kind: mixture, bases: [{kind: randon}]}",
            "x.yaml:4:36: policies.0.bases.0.kind: found 'randon', expected one of ",
        ),
        (
            "  - {kind: mixture, bases: [{kind: random, name: mine}]}",
            "x.yaml:4:29: policies.0.bases.0: found a name in the base, expected the name beside the outer",
        ),
        (
            "  - {kind: sticky, base: {kind: mixture, bases: []}, kappa: 0.5}",
            "x.yaml:4:49: policies.0.base.bases: found [], expected at least 1 item",
        ),
    ],
)
def test_mistakes_are_named_by_line_and_column(tmp_path, monkeypatch, text, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x.yaml").write_text(experiment(text))
    with pytest.raises(ConfigError) as error:
        load("x.yaml")
    assert str(error.value).startswith(message)


def test_custom_policies_within_others_are_found_at_any_depth():
    custom = {"kind": "custom", "target": "a:b", "history": 7}
    mixture = {
        "kind": "mixture",
        "bases": [{"kind": "random"}, {"kind": "sticky", "base": custom, "kappa": 0.1}],
    }
    policy = Schedule(stages=[{"base": mixture, "steps": 3}, {"base": {"kind": "bad"}}])
    assert [each.kind for each in policy.everywhere() if each.code_target] == ["custom"]
    made = Experiment(name="x", setpoints=70, policies=[policy])
    assert Experiment.model_validate(made.plain()) == made
