"""The published package's `IBGym` as an environment of Gymnasium."""

from __future__ import annotations

from itertools import product

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import TimeLimit

from ibdata.published import IBGym

KINDS = list(product(("continuous", "discrete"), ("classic", "include_past")))

pytestmark = pytest.mark.usefixtures("global_generator")


@pytest.mark.parametrize(("actions", "observations"), KINDS)
def test_the_spaces_are_those_of_the_package(actions, observations):
    env, frames = IBGym(70, "classic", actions, observations), 30 if observations == "include_past" else 1
    assert isinstance(env, gymnasium.Env)
    box = env.observation_space
    assert box == gymnasium.spaces.Box(0.0, np.tile(np.float32([100, 100, 100, 100, 1000, 1000]), frames))
    assert box.dtype == np.float32
    expected = {"discrete": gymnasium.spaces.Discrete(27), "continuous": gymnasium.spaces.Box(-1, 1, (3,))}
    assert env.action_space == expected[actions]
    assert len(env.step(env.action_space.sample())) == 4
    assert env.reset().shape == box.shape


@pytest.mark.parametrize(("actions", "observations"), KINDS)
def test_with_the_new_interface_gymnasium_s_checker_passes_without_a_warning(actions, observations):
    """Spaces, types, seeds. Warnings are errors in this suite."""
    env = IBGym(70, "delta", actions, observations, new_step_api=True)
    check_env(env, skip_render_check=True)


def test_observations_are_in_the_space_where_consumption_exceeds_the_published_bounds():
    env = TimeLimit(IBGym(100, new_step_api=True), 60)
    observation, _ = env.reset(seed=0)
    for step in range(60):
        observation, _, terminated, truncated, _ = env.step(np.float32([1, 1, 0]))
        assert observation in env.observation_space
        assert (terminated, truncated) == (False, step == 59)
    assert observation[5] > 1000.0
