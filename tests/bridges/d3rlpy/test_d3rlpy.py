"""d3rlpy reads every transition of the export, and learns from it what is scored in the benchmark."""

from typing import Any

import d3rlpy
import numpy as np
import torch
from d3rlpy.constants import ActionSpace
from d3rlpy.dataset import ReplayBuffer
from d3rlpy.logging import NoopAdapterFactory
from exporters.export_tests import ExportTests
from exporters.reading import ran

import ibdata

HISTORY = 6  # the optimized policy looks five steps back


def transitions(replay: ReplayBuffer) -> list[Any]:
    return [replay.transition_picker(one, i) for one in replay.episodes for i in range(one.transition_count)]


class TestD3rlpy(ExportTests):
    format = "d3rlpy"

    def read(self, made):
        replay = ran(made)["dataset"]
        found = transitions(replay)
        assert replay.transition_count == len(found)
        return {
            "observations": np.stack([one.observation for one in found]),
            "actions": np.stack([one.action for one in found]),
            "rewards": np.concatenate([one.reward for one in found]),
            "next_observations": np.stack([one.next_observation for one in found]),
            "terminated": np.array([one.terminal == 1 for one in found]),
        }


def test_the_next_action_of_a_last_step_is_the_padding(dataset, tmp_path):
    """ReBRAC reads it."""
    replay = ran(ibdata.export(dataset, "d3rlpy", tmp_path / "x.h5"))["dataset"]
    arrays = dataset.arrays()
    expected = np.roll(arrays["actions"], -1, axis=0)
    expected[arrays["truncated"]] = 0.5
    assert np.array_equal([one.next_action for one in transitions(replay)], expected)


def test_actions_that_are_all_whole_numbers_stay_continuous(describe, tmp_path):
    """From arrays, d3rlpy takes these for two discrete ones."""
    constant = ibdata.generate(
        describe(policies=[{"kind": "constant", "action": [-1, 0, 1]}]), tmp_path / "data", workers=1
    )
    info = ran(ibdata.export(constant, "d3rlpy", tmp_path / "x.h5"))["dataset"].dataset_info
    assert (info.action_space, info.action_size) == (ActionSpace.CONTINUOUS, 3)


def test_the_snippet_of_the_page_leaves_no_logs(use_with, tmp_path):
    (names,) = use_with("d3rlpy")
    assert names["dataset"].transition_count == 200
    assert [result.policy for result in names["scores"].results] == ["optimized", "random", "bc"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data", "target.h5"]


def fitted(config, folder, source, steps):
    """An algorithm after some steps on a set of siemens-offline."""
    overrides = ["episodes=10"]
    dataset = ibdata.generate(f"siemens-offline/{source}", folder / "data", workers=1, overrides=overrides)
    view = {"reward_scale": 0.01}
    replay = ran(ibdata.export(dataset, "d3rlpy", folder / "x.h5", history=HISTORY, view=view))["dataset"]
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
