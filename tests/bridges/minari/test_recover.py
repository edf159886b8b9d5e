"""Minari recovers the environment of a dataset from its metadata."""

from __future__ import annotations

import minari
import numpy as np
import pytest

import ibdata


def recovered(made, root, **options):
    name = options.get("split", "whole")
    ibdata.export(made, "minari", root, id=f"ibdata/{name}-v0", **options)
    found = minari.load_dataset(f"ibdata/{name}-v0")
    return found, found.recover_environment() if found.env_spec else None


@pytest.mark.parametrize("history", [1, 4])
def test_a_recovered_environment_is_that_of_the_dataset(root, tmp_path, history):
    overrides = ["setpoints=70", "episodes=2", "steps=30"]
    dataset = ibdata.generate("random.yaml", tmp_path / "data", workers=1, overrides=overrides)
    found, environment = recovered(dataset, root, history=history)
    observation, _ = environment.reset(seed=0)
    assert observation.shape == found.observation_space.shape == (6 * history,)
    assert observation[:4].tolist() == found[0].observations[0, :4].tolist() == [70, 50, 50, 50]
    for step, action in enumerate(found[0].actions):
        observation, _, terminated, truncated, _ = environment.step(action)
        assert np.isclose(observation[1:4], found[0].observations[step + 1, 1:4]).all()
    assert (terminated, truncated) == (False, True)


@pytest.mark.parametrize("view", [{}, {"observe": "markov"}])
def test_the_environment_of_moving_setpoints_has_a_moving_one(root, tmp_path, view):
    overrides = ["episodes=2", "steps=20", "output.latent=next"]
    made = ibdata.generate("drifting.yaml", tmp_path / "data", workers=1, overrides=overrides)
    found, environment = recovered(made, root, view=view)
    assert environment.observation_space.shape == found.observation_space.shape
    environment.reset(seed=0)
    shown = [environment.step(np.zeros(3, np.float32))[0][0] for _ in range(20)]
    assert len(set(shown)) > 1


def test_a_merged_environment_is_that_of_the_exported_part(root, tmp_path):
    plain = {"setpoints": 70, "episodes": 2, "steps": 5}
    parts = [
        ibdata.generate({**plain, "name": "x", "policies": [policy], **more}, tmp_path / policy, workers=1)
        for policy, more in (("random", {}), ("safe", {"dynamics": "paper"}))
    ]
    merged = ibdata.merge(parts, tmp_path / "merged")
    merged = ibdata.split(merged, by="policy", names={"random": "theirs", "safe": "printed"})
    assert recovered(merged, root)[1] is None
    for name, dynamics, episode in (("theirs", "siemens", 0), ("printed", "paper", 2)):
        found, environment = recovered(merged, root, split=name)
        assert found.env_spec.kwargs["dynamics"] == dynamics
        environment.reset(options={"dataset": merged, "episode": episode})
