"""TorchRL samples a TensorDict that is made from arrays."""

import warnings

import pytest
import torch

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # TorchRL warns of itself
    from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer
    from torchrl.data.replay_buffers.samplers import RandomSampler, SliceSampler

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::UserWarning")


@pytest.mark.parametrize(
    "sampler", [RandomSampler(), SliceSampler(slice_len=5, traj_key="episode", strict_length=True)], ids=repr
)
def test_a_tensordict_is_sampled_by_steps_and_by_episodes(use_with, sampler):
    (names,) = use_with("TorchRL")
    data = names["data"]
    assert len(data) == 1000
    assert data["next", "truncated"].sum() == 10
    assert not data["truncated"].any()
    replay = TensorDictReplayBuffer(storage=LazyTensorStorage(1000), sampler=sampler, batch_size=20)
    replay.extend(data)
    sample = replay.sample()
    assert sample["next", "reward"].shape == (20, 1)
    assert (sample["next", "reward"] < 0).all()
    if isinstance(sampler, SliceSampler):
        episodes = sample["episode"].reshape(4, 5)
        assert torch.equal(episodes, episodes[:, :1].expand(4, 5))
