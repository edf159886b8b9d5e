"""What people do with Gymnasium's environments: a row says what somebody does, and what is right."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from helpers.refusals import refused

import ibdata
from ibdata.environment import IndustrialBenchmarkEnv
from ibdata.errors import UsageError

ID = "ibdata.environment:ibdata/IndustrialBenchmark-v0"
BURNT_IN = {"start": {"burn_in": [3, 9]}, "history": 4}
TROUBLES = {"delay": {"obs_fatigue": 2}, "noise": {"obs_consumption": 5.0}, "missing": {"obs_velocity": 0.3}}
ACTIONS = np.random.default_rng(0).uniform(-1, 1, (20, 3)).astype(np.float32)


@pytest.mark.parametrize(
    "given", [{}, {"setpoint": "drifting", "dynamics": "paper"}], ids=["siemens", "paper"]
)
def test_a_history_after_a_burn_in_with_a_view_and_without(given):
    """Somebody adds previous actions to a history. What was seen before is seen as before."""
    plain, viewed = (gymnasium.make(ID, view=view, **BURNT_IN, **given) for view in (None, {"actions": True}))
    seen = [(plain.reset(seed=0)[0], viewed.reset(seed=0)[0])]
    seen += [(plain.step(action)[0], viewed.step(action)[0]) for action in ACTIONS]
    for without, beside in seen:
        np.testing.assert_array_equal(beside.reshape(4, 9)[:, :6], without.reshape(4, 6))
    assert (seen[0][0].reshape(4, 6)[:-1] != seen[0][0].reshape(4, 6)[1:]).any(axis=1).all()


def test_a_reset_within_an_episode():
    """Somebody resets in the middle of an episode, twice with one seed. Nothing of it is seen again."""
    env = gymnasium.make(ID, view={"imperfections": TROUBLES}, **BURNT_IN)
    first = env.reset(seed=5)[0]
    for action in ACTIONS:
        env.step(action)
    np.testing.assert_array_equal(env.reset(seed=5)[0], first)
    assert (env.reset()[0] != first).any()


def test_lanes_and_single_environments():
    """Somebody goes from one environment to many. Lane i sees what the environment of seed + i sees."""
    given = {"view": {"imperfections": TROUBLES, "actions": True}, **BURNT_IN}
    envs = gymnasium.make_vec(ID, num_envs=3, max_episode_steps=6, **given)
    single = [gymnasium.make(ID, max_episode_steps=6, **given) for _ in range(3)]
    np.testing.assert_array_equal(
        envs.reset(seed=2)[0], [e.reset(seed=2 + i)[0] for i, e in enumerate(single)]
    )
    for action in ACTIONS[:6]:
        seen = envs.step(np.tile(action, (3, 1)))[0]
        np.testing.assert_array_equal(seen, [env.step(action)[0] for env in single])
    seen = envs.step(np.tile(action, (3, 1)))[0]  # which begins the next episodes
    np.testing.assert_array_equal(seen, [env.reset()[0] for env in single])


@pytest.mark.parametrize("options", [{"setpoint": 20}, {"episod": 3}, {"low": -0.1, "high": 0.1}])
def test_an_unknown_option_of_reset(options):
    """Somebody gives `reset` an option of other environments. It is refused; an empty mapping is not."""
    one, many = gymnasium.make(ID), gymnasium.make_vec(ID, num_envs=2)
    for env in (one, many):
        env.reset(options={})
        refused(f"^options: found '{next(iter(options))}'", env.reset, options=options)
    many.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(UsageError, match=r"^options: found 'reset_mask', expected one of dataset, episode"):
        one.reset(options={"reset_mask": np.array([True])})


@pytest.mark.parametrize("name", ["setpoint", "dynamics", "start", "history", "view", "discrete_actions"])
def test_a_setting_that_is_set_later(name):
    """Somebody sets a setting on an environment that is made, as many others allow. It is refused."""
    for env in (gymnasium.make(ID), gymnasium.make_vec(ID, num_envs=2)):
        with pytest.raises(UsageError, match=f"^{name}: found a new value, expected it where an environment"):
            setattr(env.unwrapped, name, 20)


def test_a_subclass_that_keeps_its_settings():
    """Somebody's subclass keeps the setpoint under its name. It may, before and after it is made."""

    class Mine(IndustrialBenchmarkEnv):
        def __init__(self, setpoint):
            self.setpoint = setpoint
            super().__init__(setpoint=setpoint)
            self.history = []

    env = Mine(20)
    assert env.reset(seed=0)[0][0] == env.setpoint == 20


def test_a_wrapper_around_an_environment():
    """Somebody scales observations by a wrapper of Gymnasium. The environment keeps its own numbers."""
    env = gymnasium.make(ID, view={"imperfections": TROUBLES}, **BURNT_IN)
    scaled = gymnasium.wrappers.TransformObservation(
        gymnasium.make(ID, view={"imperfections": TROUBLES}, **BURNT_IN), lambda seen: seen / 100, None
    )
    np.testing.assert_array_equal(scaled.reset(seed=1)[0], env.reset(seed=1)[0] / 100)
    for action in ACTIONS:
        np.testing.assert_array_equal(scaled.step(action)[0], env.step(action)[0] / 100)


def test_an_agent_that_is_played_and_then_evaluated():
    """Somebody plays an agent in an environment, and evaluates it. It sees frames of the same kind."""
    shapes = []

    def agent(observations):
        shapes.append(observations.shape[1:])
        return observations[:, 1:4] / 100 - 0.5

    env = gymnasium.make(ID, view={"actions": True}, **BURNT_IN)
    agent(env.reset(seed=0)[0][None])
    ibdata.evaluate(agent, history=4, start=BURNT_IN["start"], view={"actions": True}, episodes=3, steps=4)
    assert set(shapes) == {(36,)}
