"""Minari reads every value of the export. Also pins pitfalls of Minari 0.5.4 to notice changes."""

from __future__ import annotations

import json

import gymnasium
import minari
import numpy as np
import pytest

import ibdata
from ibdata.dataset import reference_returns
from ibdata.errors import UsageError

VIEWS = {
    "markov": {"observe": "markov", "actions": True, "reward": {"consumption": 1.0, "fatigue": 1.0}},
    "troubles": {
        "imperfections": {"delay": {"obs_fatigue": 3}, "missing": {"obs_velocity": 0.2}, "mask": True},
        "reward": "delta",
    },
}


def equal(found, expected):
    assert found.dtype == expected.dtype
    assert found.shape == expected.shape
    assert found.tobytes() == expected.tobytes()


@pytest.mark.parametrize(("split", "history", "scale"), [(None, 1, 1.0), ("target", 4, 0.01)])
def test_every_value_is_there_again(dataset, root, split, history, scale):
    options = {"split": split, "history": history, "view": {"reward_scale": scale}}
    made = ibdata.export(dataset, "minari", root, **options)
    assert made.path == str(root / "ibdata" / "small-v0")
    found = minari.load_dataset("ibdata/small-v0")
    arrays = dataset.arrays(history=history, split=split)
    table = dataset.table(split=split)
    assert (found.total_episodes, found.total_steps) == (made.episodes, made.rows)
    assert len(arrays["rewards"]) == made.rows
    for i, episode in enumerate(found):
        rows = slice(25 * i, 25 * i + 25)
        assert episode.observations.shape == (26, 6 * history)
        equal(episode.observations[:-1], arrays["observations"][rows])
        equal(episode.observations[1:], arrays["next_observations"][rows])
        equal(episode.actions, arrays["actions"][rows])
        equal(episode.rewards, (arrays["rewards"][rows].astype(float) * scale).astype(np.float32))
        assert episode.terminations.tolist() == [False] * 25
        assert episode.truncations.tolist() == [False] * 24 + [True]
        for name, info in episode.infos.items():
            equal(info[:-1, 0], table[name].to_numpy()[rows])
            if name != "action_log_prob":
                equal(info[1:, 0], table[f"next_{name}"].to_numpy()[rows])
        assert len(episode.infos) == 15
        assert found.observation_space.contains(episode.observations[0])


@pytest.mark.parametrize("view", VIEWS.values(), ids=VIEWS)
def test_a_view_is_read_as_the_arrays_show_it(dataset, root, view):
    ibdata.export(dataset, "minari", root, history=3, view=view)
    found = minari.load_dataset("ibdata/small-v0")
    arrays = dataset.arrays(history=3, view=view)
    assert found.total_steps == len(arrays["rewards"])
    for i, episode in enumerate(found):
        rows = slice(25 * i, 25 * i + 25)
        equal(episode.observations[:-1], arrays["observations"][rows])
        equal(episode.observations[1:], arrays["next_observations"][rows])
        equal(episode.rewards, arrays["rewards"][rows])
        assert found.observation_space.contains(episode.observations[0])
    said = json.loads(found.storage.metadata["view"])
    assert tuple(said["frame"]) == dataset.windows(view=view).frame
    environment = found.recover_environment()
    assert environment.observation_space.shape == found.observation_space.shape
    environment.reset(seed=1)
    environment.step(environment.action_space.sample())


def test_metadata_say_where_it_comes_from(dataset, root):
    ibdata.export(dataset, "minari", root)
    found = minari.load_dataset("ibdata/small-v0")
    metadata = found.storage.metadata
    assert dataset.content_root in metadata["description"]
    assert metadata["algorithm_name"] == "random, safe"
    assert metadata["requirements"] == [f"ibdata>={ibdata.__version__}"]
    assert [m["seed"] for m in found.storage.get_episode_metadata(range(12))] == [11] * 12
    assert set(next(iter(found.storage.get_episode_metadata([0])))) == {"id", "seed", "total_steps"}


def normalized(experiment, folder, **options):
    """Minari's normalized scores of the episodes of an experiment, and the dataset itself."""
    dataset = ibdata.generate(experiment, folder / "data", workers=1)
    ibdata.export(dataset, "minari", folder / "root", **options)
    found = minari.load_dataset(f"ibdata/{experiment.name}-v0")
    returns = np.array([episode.rewards.sum(dtype=float) for episode in found])
    return minari.get_normalized_score(found, returns), dataset


@pytest.mark.parametrize("start", ["default", {"burn_in": [15, 64]}], ids=str)
def test_a_normalized_score_is_that_of_ibdata(root, tmp_path, start):
    policies = [{"kind": kind} for kind in ("random", "safe", "optimized")]
    experiment = ibdata.Experiment(
        name="one", setpoints=75, policies=policies, episodes=5, steps=1000, start=start
    )
    scores, dataset = normalized(experiment, tmp_path, view={"reward_scale": 0.01})
    expected = [result["reference_score"] / 100 for result in dataset.returns()["results"]]
    assert scores.reshape(3, 5).mean(axis=1) == pytest.approx(expected, rel=1e-5, abs=1e-5)
    assert scores.reshape(3, 5).mean(axis=1)[[0, 2]] == pytest.approx([0.0, 1.0], abs=0.25)


def test_its_ends_are_means_over_the_setpoints_of_the_export(root, tmp_path):
    splits = {"target": {"setpoint": 75}}
    experiment = ibdata.Experiment(
        name="two", setpoints=[50, 75], policies=[{"kind": "random"}], steps=1000, splits=splits
    )
    _, dataset = normalized(experiment, tmp_path)
    storage = minari.load_dataset("ibdata/two-v0").storage.metadata
    known = reference_returns.scale("siemens", "default", 1000, 1.0)
    ends = {(r.policy, r.setpoint): r.mean_return for r in known.results}
    for key, policy in (("ref_min_score", "random"), ("ref_max_score", "optimized")):
        assert storage[key] == pytest.approx((ends[policy, 50.0] + ends[policy, 75.0]) / 2)
    ibdata.export(dataset, "minari", root, split="target", id="ibdata/target-v0")
    target = minari.load_dataset("ibdata/target-v0").storage.metadata
    assert target["ref_min_score"] == ends["random", 75.0]


@pytest.mark.parametrize(
    "changes",
    [
        {"setpoints": {"drifting": 75}},
        {"setpoints": [75, 71]},
        {"steps": 999},
        {"start": {"burn_in": [1, 2]}},
    ],
    ids=str,
)
def test_there_is_no_normalized_score_without_reference_returns(root, tmp_path, changes):
    options = {"setpoints": 75, "steps": 1000, "start": "default", **changes}
    experiment = ibdata.Experiment(name="none", policies=[{"kind": "random"}], **options)
    with pytest.raises(ValueError, match="Reference score not provided"):
        normalized(experiment, tmp_path)
    metadata = minari.load_dataset("ibdata/none-v0").storage.metadata
    assert not {"ref_min_score", "ref_max_score"} & metadata.keys()


@pytest.mark.parametrize("view", [{"reward": "delta"}, {"reward": {"consumption": 1}}, {"observe": "markov"}])
def test_other_returns_have_no_normalized_score(root, tmp_path, view):
    """The last: rows without a next hidden state are left out, so the returns are those of 999 steps."""
    experiment = ibdata.Experiment(name="other", setpoints=75, policies=[{"kind": "random"}], steps=1000)
    with pytest.raises(ValueError, match="Reference score not provided"):
        normalized(experiment, tmp_path, view=view)


def test_the_end_of_an_info_is_nan_where_it_is_not_known(root, tmp_path):
    dataset = ibdata.generate("random.yaml", tmp_path / "data", workers=1, overrides=["steps=20"])
    ibdata.export(dataset, "minari", root)
    episode = minari.load_dataset("ibdata/random-v0")[3]
    assert np.isnan(episode.infos["latent_mu_v"][-1, 0])
    equal(episode.infos["latent_mu_v"][:-1, 0], dataset.table()["latent_mu_v"].to_numpy()[60:80])


def test_splitting_filtering_and_listing_work(dataset, root):
    ibdata.export(dataset, "minari", root, id="deep/er/mine-v3")
    assert not list(root.rglob(".*"))
    assert list(minari.list_local_datasets()) == ["deep/er/mine-v3"]
    found = minari.load_dataset("deep/er/mine-v3")
    assert [part.total_episodes for part in minari.split_dataset(found, sizes=[8, 4], seed=0)] == [8, 4]
    hot = found.filter_episodes(lambda episode: episode.observations[0, 0] == 70)
    assert hot.total_episodes == 6


def test_the_snippet_loads_it(dataset, tmp_path):
    made = ibdata.export(dataset, "minari", tmp_path / "elsewhere", id="mine-v0")
    names: dict = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MINARI_DATASETS_PATH", "to be put back")
        exec(made.snippet, names)
    assert names["dataset"].total_steps == 300


def test_an_episode_of_40000_steps_is_whole(root, tmp_path):
    """Longer than Minari's Arrow and Parquet can bear."""
    overrides = ["steps=40000", "setpoints=70", "episodes=2", "output={latent: false}"]
    dataset = ibdata.generate("random.yaml", tmp_path / "data", workers=1, overrides=overrides)
    ibdata.export(dataset, "minari", root)
    found = minari.load_dataset("ibdata/random-v0")
    arrays = dataset.arrays()
    for i, episode in enumerate(found):
        equal(episode.observations[1:], arrays["next_observations"][40_000 * i : 40_000 * (i + 1)])


@pytest.mark.parametrize(
    "id", ["p70.5-v0", "x/mine-v0", "ibdata/mine", "ibdata/mine-v", "", "../mine-v0", "ib//x-v0"]
)
def test_an_id_that_minari_would_not_take_is_refused(dataset, root, id):
    with pytest.raises(UsageError, match="expected NAMESPACE/NAME-vN"):
        ibdata.export(dataset, "minari", root, id=id)
    assert not root.exists()


@pytest.mark.parametrize(("folder", "id"), [("data", "ib/x-v0"), ("ib/data", "ib/x-v0"), ("", "data/x-v0")])
def test_a_folder_named_data_above_the_dataset_is_refused(dataset, root, folder, id):
    """Minari takes what holds such a folder for a dataset, and lists none of the others."""
    (root / folder).mkdir(parents=True)
    with pytest.raises(UsageError, match="found a folder named data in it"):
        ibdata.export(dataset, "minari", root, id=id)
    (root / "data").mkdir(exist_ok=True)
    with pytest.raises((ValueError, AttributeError)):
        minari.list_local_datasets()


@pytest.mark.parametrize("id", ["p70.5-v0", "x/mine-v0", "ibdata/mine"])
def test_minari_still_refuses_these_ids(root, id):
    box = gymnasium.spaces.Box(-1, 1, (1,), np.float32)
    with pytest.raises((ValueError, TypeError)):
        minari.create_dataset_from_buffers(id, [], observation_space=box, action_space=box)


def test_a_dataset_beside_it_is_left_alone_and_listed(dataset, root, monkeypatch):
    """One malformed folder breaks Minari's list for all; so a failed export leaves no folder."""
    ibdata.export(dataset, "minari", root, id="ibdata/first-v0")

    def full(made):
        assert list(minari.list_local_datasets()) == ["ibdata/first-v0"]  # while another one is written
        raise OSError(28, "no room")

    monkeypatch.setattr("ibdata.exporters._target._sync", full)
    with pytest.raises(ibdata.IbdataError, match="cannot be written: no room"):
        ibdata.export(dataset, "minari", root, id="ibdata/second-v0")
    assert list(minari.list_local_datasets()) == ["ibdata/first-v0"]
    assert [path.name for path in (root / "ibdata").iterdir()] == ["first-v0"]


def test_the_environment_is_named_with_the_datasets_own_settings(dataset, root):
    ibdata.export(dataset, "minari", root, history=3, view={"reward_scale": 0.5})
    ibdata.export(dataset, "minari", root, split="target", id="ibdata/target-v0")
    raw = json.loads((root / "ibdata" / "small-v0" / "data" / "metadata.json").read_text())["env_spec"]
    spec = json.loads(raw)
    assert (spec["id"], spec["max_episode_steps"]) == ("ibdata/IndustrialBenchmark-v0", 25)
    assert spec["entry_point"] == "ibdata.environment:IndustrialBenchmarkEnv"
    assert spec["kwargs"] == {
        "dynamics": "siemens",
        "start": "default",
        "history": 3,
        "view": {"reward_scale": 0.5},
    }
    assert minari.load_dataset("ibdata/target-v0").env_spec.kwargs["setpoint"] == 70


def test_the_snippet_of_the_page(use_with):
    (names,) = use_with("Minari")
    assert names["data"].total_steps == 200
