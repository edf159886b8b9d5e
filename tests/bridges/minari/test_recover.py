"""Minari recovers the environment of a dataset from its metadata."""

from __future__ import annotations

import minari
import numpy as np
import pytest

import ibdata


@pytest.mark.parametrize("history", [1, 4])
def test_the_recovered_environment_has_the_datasets_spaces_start_and_length(root, tmp_path, history):
    overrides = ["setpoints=70", "episodes=2", "steps=30"]
    dataset = ibdata.generate("random.yaml", tmp_path / "data", workers=1, overrides=overrides)
    ibdata.export(dataset, "minari", root, history=history, verify=True)
    found = minari.load_dataset("ibdata/random-v0")
    environment = found.recover_environment()
    observation, _ = environment.reset(seed=0)
    assert observation.shape == found.observation_space.shape == (6 * history,)
    steering = found[0].observations[0, :4]
    assert observation[:4].tolist() == steering.tolist() == [70, 50, 50, 50]
    for step in range(30):
        action = found[0].actions[step]
        observation, _, terminated, truncated, _ = environment.step(action)
        assert np.isclose(observation[1:4], found[0].observations[step + 1, 1:4]).all()
    assert (terminated, truncated) == (False, True)
