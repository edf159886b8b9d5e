"""d3rlpy reads every transition of the export. Also pins pitfalls of d3rlpy 2.8.1 to notice changes."""

from __future__ import annotations

import d3rlpy
import numpy as np
import pytest
from d3rlpy.constants import ActionSpace
from d3rlpy.dataset import EpisodeGenerator, InfiniteBuffer, ReplayBuffer

import ibdata
from ibdata import Dataset


def made(folder, **changes) -> Dataset:
    plain = {
        "name": "small",
        "setpoints": [20, 70],
        "policies": [{"kind": "random"}],
        "episodes": 3,
        "steps": 25,
        "output": {"shard_rows": 50},
        "splits": {"target": {"setpoint": 70, "episodes": 2}},
    }
    return ibdata.generate(ibdata.Experiment.model_validate({**plain, **changes}), folder, workers=1)


@pytest.fixture(scope="session")
def dataset(tmp_path_factory) -> Dataset:
    return made(tmp_path_factory.mktemp("bridge") / "small")


def loaded(dataset, path, **options) -> ReplayBuffer:
    names: dict = {}
    exec(ibdata.export(dataset, "d3rlpy", path, **options).snippet, names)
    return names["dataset"]


def transitions(replay):
    return [replay.transition_picker(e, i) for e in replay.episodes for i in range(e.transition_count)]


def from_arrays(arrays, **flags) -> ReplayBuffer:
    """What users write who know no better."""
    generator = EpisodeGenerator(
        arrays["observations"], arrays["actions"], arrays["rewards"][:, None], **flags
    )
    return ReplayBuffer(InfiniteBuffer(), episodes=generator())


@pytest.mark.parametrize(("split", "history", "scale"), [(None, 1, 1.0), ("target", 4, 0.01)])
def test_every_transition_is_there_with_its_next_observation(dataset, tmp_path, split, history, scale):
    replay = loaded(dataset, tmp_path / "x.h5", split=split, history=history, view={"reward_scale": scale})
    arrays = dataset.arrays(history=history, split=split)
    assert replay.transition_count == len(arrays["rewards"])
    for i, transition in enumerate(transitions(replay)):
        for found, expected in (
            (transition.observation, arrays["observations"][i]),
            (transition.action, arrays["actions"][i]),
            (transition.reward[0], np.float32(float(arrays["rewards"][i]) * scale)),
            (transition.next_observation, arrays["next_observations"][i]),
        ):
            assert found.dtype == np.float32
            assert found.tobytes() == expected.tobytes()
        assert transition.terminal == 0


@pytest.mark.parametrize(
    "view",
    [
        {"observe": "markov", "actions": True, "reward": "delta"},
        {"imperfections": {"delay": {"obs_fatigue": 3}, "missing": {"obs_velocity": 0.2}, "mask": True}},
    ],
    ids=["markov", "troubles"],
)
def test_a_view_is_read_as_the_arrays_show_it(dataset, tmp_path, view):
    replay = loaded(dataset, tmp_path / "x.h5", history=2, view=view)
    arrays = dataset.arrays(2, view=view)
    assert replay.transition_count == len(arrays["rewards"])
    for i, transition in enumerate(transitions(replay)):
        assert (transition.observation == arrays["observations"][i]).all()
        assert (transition.next_observation == arrays["next_observations"][i]).all()
        assert transition.reward[0] == arrays["rewards"][i]


def test_the_appended_row_is_never_sampled(dataset, tmp_path):
    replay = loaded(dataset, tmp_path / "x.h5")
    rewards = np.concatenate([replay.sample_transition_batch(256).rewards[:, 0] for _ in range(40)])
    assert len(rewards) == 10_240
    assert (rewards < 0).all()
    assert len(np.unique(rewards)) == 150


def test_naive_conversions_lose_or_spoil_transitions(dataset):
    """Timeouts lose the last transition of each episode, terminals forbid to bootstrap there."""
    arrays = dataset.arrays()
    never = np.zeros(150, np.float32)
    ends = arrays["truncated"].astype(np.float32)
    lost = from_arrays(arrays, terminals=never, timeouts=ends)
    assert lost.transition_count == 150 - 6
    spoilt = from_arrays(arrays, terminals=ends, timeouts=never)
    assert sum(t.terminal for t in transitions(spoilt)) == 6
    with pytest.raises(AssertionError, match="No episode termination was found"):
        from_arrays(arrays, terminals=never, timeouts=never)


def test_actions_that_are_all_whole_numbers_stay_continuous(tmp_path):
    """d3rlpy looks at the first episode's actions; from arrays it takes these for two discrete ones."""
    dataset = made(tmp_path / "data", policies=[{"kind": "constant", "action": [-1, 0, 1]}])
    info = loaded(dataset, tmp_path / "x.h5").dataset_info
    assert (info.action_space, info.action_size) == (ActionSpace.CONTINUOUS, 3)
    arrays = dataset.arrays()
    zeros = np.zeros(150, np.float32)
    trap = from_arrays(arrays, terminals=zeros, timeouts=arrays["truncated"].astype(np.float32))
    assert (trap.dataset_info.action_space, trap.dataset_info.action_size) == (ActionSpace.DISCRETE, 2)


def test_float64_data_become_float32(tmp_path):
    dataset = made(tmp_path / "data", output={"dtype": "float64"})
    episode = loaded(dataset, tmp_path / "x.h5").episodes[0]
    assert {episode.observations.dtype, episode.actions.dtype, episode.rewards.dtype} == {np.dtype("float32")}


def test_what_d3rlpy_writes_itself_has_the_same_form(dataset, tmp_path):
    import h5py

    replay = loaded(dataset, tmp_path / "ours.h5")
    with (tmp_path / "theirs.h5").open("w+b") as file:
        replay.dump(file)
    with h5py.File(tmp_path / "ours.h5") as ours, h5py.File(tmp_path / "theirs.h5") as theirs:
        assert set(ours) == set(theirs)
        assert all(np.array_equal(ours[name][()], theirs[name][()]) for name in ours)
        assert all(ours[name].dtype == theirs[name].dtype for name in ours)


def test_the_version_is_the_one_that_was_tried():
    assert d3rlpy.__version__ == "2.8.1"


def test_the_snippet_of_the_page_leaves_no_logs(use_with, tmp_path):
    (names,) = use_with("d3rlpy")
    assert names["dataset"].transition_count == 200
    assert [result.policy for result in names["scores"].results] == ["optimized", "random", "bc"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data", "target.h5"]
