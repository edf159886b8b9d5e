"""Minari reads every value of the export, with metadata, environment, ids and scores."""

from unittest.mock import ANY

import gymnasium
import minari
import numpy as np
import pytest
from exporters.export_tests import ExportTests
from exporters.reading import equal, ran
from helpers.refusals import refused

import ibdata
from ibdata.dataset import reference_returns


@pytest.fixture
def root(tmp_path, monkeypatch):
    """Minari's root, and nothing of the user's."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "root"))
    return tmp_path / "root"


class TestMinari(ExportTests):
    format = "minari"

    @pytest.fixture(autouse=True)
    def put_back(self, monkeypatch):
        monkeypatch.setenv("MINARI_DATASETS_PATH", "set by the snippet")

    def read(self, made):
        found = ran(made)["dataset"]
        assert (found.total_episodes, found.total_steps) == (made.episodes, made.rows)
        episodes = list(found)
        assert all(map(found.observation_space.contains, episodes[0].observations))
        costs = [one.infos["cost"][:-1, 0] for one in episodes if "cost" in one.infos]
        arrays = {
            "observations": [one.observations[:-1] for one in episodes],
            "actions": [one.actions for one in episodes],
            "rewards": [one.rewards for one in episodes],
            "next_observations": [one.observations[1:] for one in episodes],
            "terminated": [one.terminations for one in episodes],
            "truncated": [one.truncations for one in episodes],
            **({"costs": costs} if costs else {}),
        }
        return {name: np.concatenate(values) for name, values in arrays.items()}


def test_infos_are_the_columns_to_the_end_of_the_episode(dataset, root):
    made = ibdata.export(dataset, "minari", root)
    assert made.path == str(root / "ibdata" / "small-v0")
    table = dataset.table()
    for i, episode in enumerate(minari.load_dataset("ibdata/small-v0")):
        assert len(episode.infos) == 15
        for name, info in episode.infos.items():
            equal(info[:-1, 0], table[name].to_numpy()[40 * i : 40 * i + 40])
            if name != "action_log_prob":
                equal(info[1:, 0], table[f"next_{name}"].to_numpy()[40 * i : 40 * i + 40])


def test_metadata_say_where_it_comes_from(dataset, root):
    ibdata.export(dataset, "minari", root)
    found = minari.load_dataset("ibdata/small-v0")
    metadata = found.storage.metadata
    assert dataset.content_root in metadata["description"]
    assert metadata["algorithm_name"] == "calm, random"
    assert metadata["requirements"] == [f"ibdata>={ibdata.__version__}"]
    # No reset(seed=…) plays an episode again.
    assert not any("seed" in m for m in found.storage.get_episode_metadata(range(12)))
    assert "ibdata/small-v0" in minari.list_local_datasets()


def exported(folder, changes, **options):
    plain = {"name": "one", "setpoints": 75, "policies": ["random"], "steps": 1000}
    dataset = ibdata.generate({**plain, **changes}, folder / "data", workers=1)
    ibdata.export(dataset, "minari", folder / "root", **options)
    return dataset, minari.load_dataset("ibdata/one-v0")


@pytest.mark.parametrize("start", ["default", {"burn_in": [15, 64]}])
def test_a_normalized_score_is_that_of_ibdata(root, tmp_path, start):
    changes = {"policies": ["random", "safe", "optimized"], "episodes": 5, "start": start}
    dataset, found = exported(tmp_path, changes, view={"reward_scale": 0.01})
    returns = np.array([episode.rewards.sum(dtype=float) for episode in found])
    scores = minari.get_normalized_score(found, returns).reshape(3, 5).mean(axis=1)
    expected = [result["score"] / 100 for result in dataset.returns()["results"]]
    assert scores == pytest.approx(expected, rel=1e-5, abs=1e-5)
    assert scores[[0, 2]] == pytest.approx([0.0, 1.0], abs=0.25)


def test_its_ends_are_means_over_the_setpoints_of_the_export(root, tmp_path):
    changes = {"setpoints": [50, 75], "splits": {"target": {"setpoint": 75}}}
    dataset, found = exported(tmp_path, changes)
    known = reference_returns.scale("siemens", "default", 1000, 1.0)
    ends = {(r.policy, r.setpoint): r.mean_return for r in known.results}
    for key, policy in (("ref_min_score", "random"), ("ref_max_score", "optimized")):
        assert found.storage.metadata[key] == pytest.approx((ends[policy, 50.0] + ends[policy, 75.0]) / 2)
    ibdata.export(dataset, "minari", root, split="target", id="ibdata/target-v0")
    target = minari.load_dataset("ibdata/target-v0").storage.metadata
    assert target["ref_min_score"] == ends["random", 75.0]


@pytest.mark.parametrize(
    ("changes", "view"),
    [
        ({"setpoints": [75, 71]}, {}),
        ({}, {"reward": "delta"}),
        ({}, {"observe": "markov"}),  # whose episodes lack the last row, which has no next hidden state
    ],
)
def test_other_returns_have_no_normalized_score(root, tmp_path, changes, view):
    _, found = exported(tmp_path, changes, view=view)
    assert not {"ref_min_score", "ref_max_score"} & found.storage.metadata.keys()


@pytest.mark.parametrize(
    ("id", "line"),
    [
        ("ibdata/mine", "expected NAMESPACE/NAME-vN"),
        ("../mine-v0", "expected NAMESPACE/NAME-vN"),
        ("ib/x-v0", "found a folder named data in it"),  # which Minari takes for a dataset
        ("data/x-v0", "found a folder named data in it"),
    ],
)
def test_an_id_that_minari_would_not_take_is_refused(dataset, root, id, line):
    (root / "ib/data").mkdir(parents=True)
    refused(line, ibdata.export, dataset, "minari", root, id=id)


def test_the_snippet_of_the_page(use_with):
    (names,) = use_with("Minari")
    assert names["data"].total_steps == 200


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
    overrides = ["setpoints={drifting: 60}", "episodes=2", "steps=20", "output.latent=next"]
    made = ibdata.generate("drifting.yaml", tmp_path / "data", workers=1, overrides=overrides)
    _, environment = recovered(made, root, view=view)
    environment.reset(seed=0)
    shown = [environment.step(np.zeros(3, np.float32))[0][0] for _ in range(20)]
    assert environment.spec.kwargs["setpoint"] == {"drifting": 60}
    assert len(set(shown)) > 1


VIEWS = {
    "classic": {},
    "markov": {"observe": "markov", "actions": True},
    "scaled": {"reward_scale": 0.01},
    "noisy": {"imperfections": {"noise": {"obs_fatigue": 1.0}, "delay": {"obs_velocity": 2}}},
}


@pytest.mark.parametrize("view", VIEWS.values(), ids=VIEWS)
@pytest.mark.parametrize("setpoints", [70, {"drifting": 30}, [20, 70]], ids=["one", "moving", "several"])
@pytest.mark.parametrize("dynamics", ["siemens", "paper"])
def test_the_space_of_the_dataset_is_that_of_its_environment(root, tmp_path, view, setpoints, dynamics):
    plain = {"name": "m", "setpoints": setpoints, "dynamics": dynamics, "policies": ["random"], "steps": 9}
    made = ibdata.generate({**plain, "output": {"latent": "next"}}, tmp_path / "data", workers=1)
    found, environment = recovered(made, root, view=view, history=2)
    if isinstance(setpoints, list):  # no environment is that of all, and none at another setpoint is made up
        assert environment is None
        options = {"setpoint": 20, "dynamics": dynamics, "view": view, "history": 2}
        environment = gymnasium.make("ibdata.environment:ibdata/IndustrialBenchmark-v0", **options)
    assert found.observation_space == environment.observation_space
    assert found.action_space == environment.action_space
    assert all(map(found.observation_space.contains, found[0].observations))


def test_episodes_of_several_lengths_have_no_environment_and_those_of_one_length_have(root, tmp_path):
    plain = {"name": "m", "setpoints": 50, "policies": ["random"]}
    parts = [
        ibdata.generate({**plain, "steps": steps, "seed": steps}, tmp_path / str(steps), workers=1)
        for steps in (9, 5)
    ]
    both = ibdata.merge(parts, tmp_path / "both")
    assert recovered(both, root) == (ANY, None)
    ibdata.export(both.select(episodes=1), "minari", root, id="ibdata/short-v0")
    assert minari.load_dataset("ibdata/short-v0").recover_environment().spec.max_episode_steps == 5
