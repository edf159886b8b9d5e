"""The environments of shipped sets."""

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.refusals import refused

import ibdata
from ibdata.tools import make as room


@pytest.fixture(autouse=True)
def _cache(tmp_path, monkeypatch):
    monkeypatch.setattr(room, "cache_folders", lambda: SimpleNamespace(folders=(str(tmp_path),)))


def test_the_environment_is_that_of_the_set():
    env, train, validation = ibdata.make("siemens-offline/optimized-40", history=30)
    assert (train["observations"].shape, validation["observations"].shape) == ((90_000, 180), (10_000, 180))
    observation, _ = env.reset(seed=0)
    assert (observation.shape, env.spec.max_episode_steps) == ((180,), 1000)
    assert observation[:4].tolist() == [70.0, 50.0, 50.0, 50.0]
    dataset = ibdata.open(room.cache_folders().folders[0] + "/datasets/siemens-offline-optimized-40")
    env.reset(options={"dataset": dataset, "episode": 99})
    rewards = [env.step(action)[1] for action in validation["actions"][-1000:][:20]]
    assert np.float32(rewards).tolist() == validation["rewards"][-1000:][:20].tolist()


def test_a_set_with_several_setpoints_has_an_environment_at_one():
    refused("setpoint: found None, expected one of 10, 30, 50, 70, 90, for the", ibdata.make, "drifting")
    view = {"reward_scale": 0.01}
    env, train, _ = ibdata.make("drifting", setpoint=30, view=view, seed=5)
    observation, _ = env.reset(seed=0)
    assert abs(observation[0] - 30.0) < 2.0
    rewards = [env.step(env.action_space.sample())[1] for _ in range(20)]
    assert -20.0 < np.mean(rewards) < -1.0
    assert -20.0 < train["rewards"].mean() < -1.0
