"""What the export gives to Minari's writer, for which stand-ins take its place."""

from __future__ import annotations

import json
import sys
from types import ModuleType, SimpleNamespace

import h5py
import numpy as np
import pytest
from exporters.reading import equal

import ibdata
from ibdata.dataset.reference_returns import scale
from ibdata.errors import IbdataError, UsageError


class Storage:
    """Minari's storage, which keeps what it is given."""

    made: Storage

    @classmethod
    def new(cls, path, observation_space, action_space, env_spec, data_format):
        path.mkdir()
        cls.made = cls()
        cls.made.path = path
        cls.made.environment, cls.made.spaces = env_spec, (observation_space, action_space)
        return cls.made

    def update_metadata(self, metadata):
        self.metadata = metadata
        (self.path / "metadata.json").write_text(json.dumps(metadata))

    def update_episodes(self, episodes):
        self.episodes = list(episodes)
        with h5py.File(self.path / "main_data.hdf5", "x") as file:
            for number, episode in enumerate(self.episodes):
                for name, values in {**vars(episode), **episode.infos}.items():
                    if name != "infos":
                        group = "infos/" if name in episode.infos else ""
                        file[f"episode_{number}/{group}{name}"] = values
            self.harmed(file)

    def harmed(self, file):
        """Nothing; a test replaces this."""


STAND_INS = {
    "PIL": {},
    "minari": {"__version__": "0"},
    "minari.data_collector": {"EpisodeBuffer": SimpleNamespace},
    "minari.dataset.minari_storage": {"MinariStorage": Storage},
    "gymnasium.spaces": {"Box": lambda low, high, dtype: (low, high)},
    "gymnasium.envs.registration": {"EnvSpec": lambda *args, **options: SimpleNamespace(**options)},
}


@pytest.fixture
def exported(tmp_path, monkeypatch):
    """A function that exports a dataset, and returns what the writer was given."""
    for name, members in STAND_INS.items():
        module = ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)
    for name in ("minari.dataset", "gymnasium", "gymnasium.envs"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))

    def export(dataset, **options):
        ibdata.export(dataset, "minari", tmp_path / "root", overwrite=True, **options)
        return Storage.made

    return export


def test_what_minari_loses_is_an_error(long, exported, monkeypatch):
    monkeypatch.setattr(Storage, "harmed", lambda self, file: file.__delitem__("episode_3/infos/latent_mu_v"))
    with pytest.raises(IbdataError, match="long-v0: cannot be written: HDF5 has lost what it wrote"):
        exported(long)


def test_a_minari_dataset_of_others_is_not_replaced(long, exported, tmp_path):
    exported(long)
    exported(long)
    metadata = tmp_path / "root/ibdata/long-v0/data/metadata.json"
    metadata.write_text('{"dataset_id": "ibdata/long-v0"}')
    with pytest.raises(UsageError, match="long-v0: found no export of ibdata; move it away"):
        exported(long)
    assert metadata.read_text() == '{"dataset_id": "ibdata/long-v0"}'


@pytest.fixture(scope="module")
def long(tmp_path_factory):
    """Episodes that have scores, at two setpoints."""
    experiment = {
        "name": "long",
        "setpoints": [50, 75],
        "policies": ["random", "safe"],
        "steps": 1000,
        "splits": {"target": {"setpoint": 75}},
        "output": {"latent": True},
    }
    return ibdata.generate(experiment, tmp_path_factory.mktemp("minari") / "long", workers=1)


@pytest.mark.parametrize(
    "options",
    [{"split": "target", "history": 4, "view": {"reward_scale": 0.01}}, {"view": {"observe": "markov"}}],
    ids=["split", "markov"],
)
def test_an_episode_has_an_observation_more_than_transitions(dataset, exported, options):
    episodes, arrays = exported(dataset, **options).episodes, dataset.arrays(**options)
    assert len(episodes) == len(arrays["rewards"]) // 40
    for i, episode in enumerate(episodes):
        rows = slice(40 * i, 40 * i + 40)
        equal(episode.observations[:-1], arrays["observations"][rows])
        equal(episode.observations[1:], arrays["next_observations"][rows])
        for name in ("actions", "rewards"):
            equal(getattr(episode, name), arrays[name][rows])
        assert not episode.terminations.any()
        assert np.flatnonzero(episode.truncations).tolist() == [39]
        assert not hasattr(episode, "seed")


def test_infos_stand_at_the_times_of_their_observations(dataset, exported):
    table = dataset.table()
    for i, episode in enumerate(exported(dataset).episodes):
        rows = slice(40 * i, 40 * i + 40)
        assert len(episode.infos) == 15
        for name, info in episode.infos.items():
            assert info.shape == (41, 1)
            equal(info[:-1, 0], table[name].to_numpy()[rows])
            if name == "action_log_prob":
                assert np.isnan(info[-1, 0])
            else:
                equal(info[1:, 0], table[f"next_{name}"].to_numpy()[rows])


def test_infos_end_with_nan_where_the_dataset_ends_before(long, exported):
    table = long.table()
    for i, episode in enumerate(exported(long).episodes):
        for name, info in episode.infos.items():
            equal(info[:-1, 0], table[name].to_numpy()[1000 * i : 1000 * i + 1000])
            assert np.isnan(info[-1, 0])


def test_the_ends_of_the_score_are_means_over_the_setpoints(long, exported):
    known = scale("siemens", "default", 1000, 1.0).results
    for split, setpoints in ((None, [50.0, 75.0]), ("target", [75.0])):
        metadata = exported(long, split=split, view={"reward_scale": 0.5}).metadata
        for key, policy in (("ref_min_score", "random"), ("ref_max_score", "optimized")):
            returns = [x.mean_return for x in known if x.policy == policy and x.setpoint in setpoints]
            assert len(returns) == len(setpoints)
            assert metadata[key] == pytest.approx(0.5 * np.mean(returns), rel=1e-12)


def test_a_normalized_score_is_that_of_the_dataset(long, exported):
    written = exported(long, split="target")
    low, high = (written.metadata[key] for key in ("ref_min_score", "ref_max_score"))
    found = [(x.rewards.sum(dtype=float) - low) / (high - low) for x in written.episodes]
    expected = [x["reference_score"] / 100 for x in long.returns()["results"] if x["setpoint"] == 75]
    assert found == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(("first", "known"), [([30, 70], True), ([30, 75], False)])
def test_the_ends_of_moving_setpoints_are_those_of_their_scale(first, known, exported, tmp_path):
    plain = {"name": "moving", "setpoints": {"drifting": first}, "policies": ["random"], "steps": 1000}
    metadata = exported(ibdata.generate(plain, tmp_path / "moving", workers=1)).metadata
    ends = scale("siemens", "default", 1000, 1.0, drifting=True).ends(first) if known else None
    assert (metadata.get("ref_min_score"), metadata.get("ref_max_score")) == (ends or (None, None))


@pytest.mark.parametrize("view", [{"reward": "delta"}, {"observe": "markov"}], ids=["reward", "left out"])
def test_other_rewards_and_lengths_have_no_score(long, exported, view):
    assert not {"ref_min_score", "ref_max_score"} & exported(long, view=view).metadata.keys()


def test_the_environment_is_that_of_the_episodes(long, exported):
    options = {"history": 3, "view": {"reward_scale": 0.5}}
    made = exported(long, **options).environment
    assert made.kwargs == {**options, "dynamics": "siemens", "start": "default"}  # its setpoints differ
    assert made.max_episode_steps == 1000
    assert exported(long, split="target").environment.kwargs["setpoint"] == 75


def test_unequal_numbers_of_episodes_have_no_score(long, exported, tmp_path):
    """Minari knows one pair of ends for all episodes, which would weigh the setpoints otherwise."""
    [p, *_] = long.episodes["setpoint"].unique()
    plain = {"name": "more", "setpoints": float(p), "policies": ["random"], "steps": 1000, "seed": 9}
    more = ibdata.generate(plain, tmp_path / "more", workers=1)
    merged = ibdata.merge([long, more], out=tmp_path / "merged")
    assert not {"ref_min_score", "ref_max_score"} & exported(merged).metadata.keys()
