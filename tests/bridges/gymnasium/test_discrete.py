"""Discrete actions, and lanes and actions that are refused."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import ibdata
from ibdata.environment import IndustrialBenchmarkEnv, IndustrialBenchmarkVectorEnv
from ibdata.environment.actions import DISCRETE
from ibdata.errors import UsageError

ID = "ibdata/IndustrialBenchmark-v0"
LANES = 3
SETTINGS = (
    {"setpoint": 33},
    {"dynamics": "paper", "history": 2},
    {"setpoint": "drifting", "history": 3, "start": "uniform"},
)


@pytest.mark.parametrize("lanes", [3, -1, [0, 0], [], [0.0], "all", [[0]]], ids=str)
def test_lanes_that_are_not_there_are_refused_in_one_line(lanes):
    many = IndustrialBenchmarkVectorEnv(LANES)
    with pytest.raises(
        UsageError, match=r"^lanes: found .*, expected (one of 0 to 2|whole numbers|different ones)$"
    ):
        many.set_state(ibdata.dynamics.initial_state([70.0]), lanes)
    with pytest.raises(
        UsageError, match=r"^set_state: found a state of 1 lane, expected a state of 3 lanes$"
    ):
        many.set_state(ibdata.dynamics.initial_state([70.0]))


@pytest.mark.parametrize("given", SETTINGS, ids=str)
def test_discrete_actions_do_what_those_of_their_place_do(given):
    """One lane, many lanes, and Gymnasium's loop over single ones."""
    one = gymnasium.make(ID, discrete_actions=True, **given)
    check_env(gymnasium.make(ID, discrete_actions=True, **given).unwrapped, skip_render_check=True)
    assert one.action_space == gymnasium.spaces.Discrete(27)
    other = gymnasium.make(ID, **given)
    many = gymnasium.make_vec(ID, num_envs=LANES, discrete_actions=True, max_episode_steps=10, **given)
    loop = gymnasium.make_vec(
        ID,
        num_envs=LANES,
        vectorization_mode="sync",
        discrete_actions=True,
        max_episode_steps=10,
        **given,
    )
    assert many.action_space == loop.action_space
    for env in (one, other, many, loop):
        env.reset(seed=1)
    many.action_space.seed(0)
    one.action_space.seed(0)
    for _ in range(30):
        action = one.action_space.sample()
        seen, reward, *_ = one.step(action)
        expected, its, *_ = other.step(np.array(DISCRETE[action]))
        assert (seen.tolist(), reward) == (expected.tolist(), its)
        actions = many.action_space.sample()
        found, rewards, *_ = many.step(actions)
        theirs = loop.step(actions)
        np.testing.assert_array_equal(found, theirs[0])
        np.testing.assert_array_equal(rewards, theirs[1])


def test_wrong_discrete_actions_are_refused_in_one_line():
    env = IndustrialBenchmarkEnv(discrete_actions=True)
    env.reset(seed=0)
    with pytest.raises(UsageError, match=r"^action: found 27, expected a whole number from 0 to 26$"):
        env.step(27)
    many = IndustrialBenchmarkVectorEnv(LANES, discrete_actions=True)
    many.reset(seed=0)
    with pytest.raises(UsageError, match=r"^action: found .*, expected 3 whole numbers from 0 to 26$"):
        many.step(np.zeros((3, 3), dtype=np.float32))
    for kind in (IndustrialBenchmarkEnv, IndustrialBenchmarkVectorEnv):
        with pytest.raises(UsageError, match="discrete_actions: found 'yes', expected True or False"):
            kind(discrete_actions="yes")
