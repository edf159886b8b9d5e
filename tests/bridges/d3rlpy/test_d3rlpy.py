"""d3rlpy reads every transition of the export, and learns from it what is scored in the benchmark."""

import d3rlpy
import numpy as np
import pytest
import torch
from d3rlpy.constants import ActionSpace
from d3rlpy.dataset import ReplayBuffer
from d3rlpy.logging import NoopAdapterFactory

import ibdata
from ibdata import Dataset

HISTORY = 6  # the optimized policy looks five steps back


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
    return ibdata.generate({**plain, **changes}, folder, workers=1)


@pytest.fixture(scope="session")
def dataset(tmp_path_factory) -> Dataset:
    return made(tmp_path_factory.mktemp("bridge") / "small")


def loaded(dataset, path, **options) -> ReplayBuffer:
    names: dict = {}
    exec(ibdata.export(dataset, "d3rlpy", path, **options).snippet, names)
    return names["dataset"]


@pytest.mark.parametrize(
    "options",
    [
        {"split": "target", "history": 4, "view": {"reward_scale": 0.01}},
        {"history": 2, "view": {"observe": "markov", "actions": True, "reward": "delta"}},
    ],
    ids=["split", "markov"],
)
def test_every_transition_is_there_with_its_next_observation(dataset, tmp_path, options):
    replay, arrays = loaded(dataset, tmp_path / "x.h5", **options), dataset.arrays(**options)
    transitions = [
        replay.transition_picker(episode, i)
        for episode in replay.episodes
        for i in range(episode.transition_count)
    ]
    assert replay.transition_count == len(transitions) == len(arrays["rewards"])
    for i, transition in enumerate(transitions):
        for found, expected in (
            (transition.observation, arrays["observations"][i]),
            (transition.action, arrays["actions"][i]),
            (transition.reward[0], arrays["rewards"][i]),
            (transition.next_observation, arrays["next_observations"][i]),
        ):
            assert found.dtype == np.float32
            assert found.tobytes() == expected.tobytes()
        assert transition.terminal == 0
        last = arrays["truncated"][i]  # whose next action, which ReBRAC reads, is the padding
        assert (transition.next_action == (0.5 if last else arrays["actions"][i + 1])).all()


def test_actions_that_are_all_whole_numbers_stay_continuous(tmp_path):
    """From arrays, d3rlpy takes these for two discrete ones. Of float64 data, it gets float32."""
    constant = [{"kind": "constant", "action": [-1, 0, 1]}]
    replay = loaded(
        made(tmp_path / "data", policies=constant, output={"dtype": "float64"}), tmp_path / "x.h5"
    )
    info, episode = replay.dataset_info, replay.episodes[0]
    assert (info.action_space, info.action_size) == (ActionSpace.CONTINUOUS, 3)
    assert {episode.observations.dtype, episode.actions.dtype, episode.rewards.dtype} == {np.dtype("float32")}


def test_the_snippet_of_the_page_leaves_no_logs(use_with, tmp_path):
    (names,) = use_with("d3rlpy")
    assert names["dataset"].transition_count == 200
    assert [result.policy for result in names["scores"].results] == ["optimized", "random", "bc"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data", "target.h5"]


def fitted(config, folder, source, steps):
    """An algorithm after some steps on a set of siemens-offline."""
    overrides = ["episodes=10"]
    dataset = ibdata.generate(f"siemens-offline/{source}", folder / "data", workers=1, overrides=overrides)
    replay = loaded(dataset, folder / "x.h5", history=HISTORY, view={"reward_scale": 0.01})
    torch.set_num_threads(1)
    d3rlpy.seed(0)
    scaler = d3rlpy.preprocessing.StandardObservationScaler()
    algorithm = config(observation_scaler=scaler, batch_size=256).create()
    quiet = {"logger_adapter": NoopAdapterFactory(), "show_progress": False}
    algorithm.fit(replay, n_steps=steps, n_steps_per_epoch=steps, **quiet)
    return algorithm


def test_behaviour_cloning_gets_the_return_of_its_teacher(tmp_path):
    """The two differ by 11.6 (in hundreds) from random actions; the standard error is below 0.1."""
    cloned = fitted(d3rlpy.algos.BCConfig, tmp_path, "optimized-0", 1000)
    found = ibdata.evaluate(["optimized", "random", cloned], 70, history=HISTORY).results
    optimized, random, clone = (result.mean_return / 100 for result in found)
    assert random < optimized - 10
    assert abs(clone - optimized) < 1
