"""TorchRL: the Minari export in its replay buffer, and a TensorDict from arrays."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import ibdata

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::UserWarning")


def test_the_replay_buffer_keeps_every_transition(dataset, root):
    from torchrl.data.datasets import MinariExperienceReplay

    ibdata.export(dataset, "minari", root)
    replay = MinariExperienceReplay("ibdata/small-v0", batch_size=32, load_from_local_minari=True)
    data, arrays = replay[:], dataset.arrays()
    assert len(replay) == 300
    pairs = [
        (data["observation"], arrays["observations"]),
        (data["action"], arrays["actions"]),
        (data["next", "observation"], arrays["next_observations"]),
        (data["next", "reward"][:, 0], arrays["rewards"]),
        (data["next", "truncated"][:, 0], arrays["truncated"]),
        (data["next", "terminated"][:, 0], arrays["terminated"]),
    ]
    for found, expected in pairs:
        assert np.array_equal(found.numpy(), expected)
    assert replay.sample()["observation"].shape == (32, 6)


def test_a_tensordict_from_arrays_is_sampled_by_steps_and_by_episodes(dataset):
    from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer
    from torchrl.data.replay_buffers.samplers import RandomSampler, SliceSampler

    names = use_with("TorchRL", dataset)
    data = names["data"]
    for sampler in (RandomSampler(), SliceSampler(slice_len=5, traj_key="episode", strict_length=True)):
        replay = TensorDictReplayBuffer(storage=LazyTensorStorage(300), sampler=sampler, batch_size=20)
        replay.extend(data)
        sample = replay.sample()
        assert sample["next", "reward"].shape == (20, 1)
        if isinstance(sampler, SliceSampler):
            episodes = sample["episode"].reshape(4, 5)
            assert torch.equal(episodes, episodes[:, :1].expand(4, 5))
