"""TorchRL: a TensorDict from arrays, and the Minari export in TorchRL's reader."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import torch
from tensordict import TensorDict

import ibdata

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # TorchRL warns of itself
    from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer
    from torchrl.data.datasets import MinariExperienceReplay
    from torchrl.data.replay_buffers.samplers import RandomSampler, SliceSampler

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::UserWarning")


@pytest.fixture
def replay(dataset, root, tmp_path):
    """TorchRL's view of the Minari export; `root`, so that nothing lands in the user's cache."""
    ibdata.export(dataset, "minari", root)

    def load() -> MinariExperienceReplay:
        return MinariExperienceReplay(
            "ibdata/small-v0", batch_size=32, root=tmp_path / "torchrl", load_from_local_minari=True
        )

    return load


def test_the_page_warns_rightly_of_torchrls_reader_of_minari(replay):
    """When this fails, TorchRL has been mended: take the warning out of docs/use-with.md."""
    data = replay()[:]
    assert len(data) == 300
    assert not data["observation"].any()
    assert not data["next", "reward"].any()


def test_the_export_is_not_to_blame(replay, dataset, monkeypatch):
    """TorchRL reads all of it, but saves it with `memmap_like`, which makes room and copies nothing."""
    monkeypatch.setattr(TensorDict, "memmap_like", TensorDict.memmap)
    data, arrays = replay()[:], dataset.arrays()
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
