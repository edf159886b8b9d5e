"""Every value in each format, read by the format's own reader or by its rules."""

from __future__ import annotations

import h5py
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

import ibdata
from ibdata import Experiment
from ibdata.errors import UsageError
from ibdata.exporters import d3rlpy, neorl

CASES = [(None, 1, 1.0), ("target", 1, 0.01), (None, 4, 1.0)]
cases = pytest.mark.parametrize(("split", "history", "scale"), CASES)


def equal(found, expected):
    found, expected = np.asarray(found), np.asarray(expected)
    assert found.dtype == expected.dtype
    assert found.shape == expected.shape
    assert found.tobytes() == expected.tobytes()


def arrays_of(made):
    """The keys of an NPZ or HDF5 file, groups flattened."""
    if made.format == "npz":
        return dict(np.load(made.path))
    found = {}
    with h5py.File(made.path) as file:
        file.visititems(lambda name, item: found.update({name: item[()]} if hasattr(item, "shape") else {}))
    return found


@cases
@pytest.mark.parametrize("to", ["npz", "d4rl"])
def test_npz_and_d4rl_hold_the_same_keys_and_every_transition(
    dataset, plain, tmp_path, to, split, history, scale
):
    options = {"split": split, "history": history, "reward_scale": scale}
    data = arrays_of(ibdata.export(dataset, to, tmp_path / "made", **options, verify=True))
    expected = plain(split, history, scale)
    rows = expected.pop("rows")
    pairs = {
        "terminals": "terminated",
        "timeouts": "truncated",
        "infos/episode": "episode",
        "infos/step": "step",
    }
    for name in ("observations", "actions", "rewards", "next_observations", *pairs):
        equal(data[name], expected[pairs.get(name, name)])
    infos = {name for name in data if name.startswith("infos/")}
    assert len(infos) == 2 + 14 + 14 + 1
    for name in infos - {"infos/episode", "infos/step"}:
        equal(data[name], np.float32([row[name.removeprefix("infos/")] for row in rows]))
    assert len(data) == 6 + len(infos)


def test_every_dataset_of_d4rl_has_an_entry_a_row_and_metadata_are_attributes(dataset, tmp_path):
    """D4RL's sequence_dataset takes every key at every row; a scalar there ends it."""
    made = ibdata.export(dataset, "d4rl", tmp_path / "made", reward_scale=0.01, verify=True)
    data = arrays_of(made)
    assert all(len(array) == 480 for array in data.values())
    assert data["rewards"].shape == data["terminals"].shape == (480,)
    with h5py.File(made.path) as file:
        assert file.attrs["content_root"] == dataset.content_root
        assert file.attrs["reward_scale"] == 0.01


def test_by_the_rules_of_d4rls_own_reader_an_episode_loses_its_last_row(dataset, tmp_path):
    """qlearning_dataset shifts observations and leaves out rows that end by time; hence its warning."""
    data = arrays_of(ibdata.export(dataset, "d4rl", tmp_path / "made", verify=True))
    kept = [i for i in range(len(data["rewards"]) - 1) if not data["timeouts"][i]]
    assert len(kept) == 480 - 12
    for i in kept:
        equal(data["next_observations"][i], data["observations"][i + 1])


@pytest.mark.parametrize("num", [1, 2, 4])
def test_neorls_loader_finds_the_trajectories(dataset, plain, tmp_path, num):
    """By the rules of its loader: a 0 in front of index, then the rows before index[num]."""
    made = ibdata.export(dataset, "neorl", tmp_path / "made", split="target", verify=True)
    data = dict(np.load(made.path))
    expected = plain("target", 30)
    assert set(data) == {"obs", "next_obs", "action", "reward", "done", "index"}
    assert data["obs"].shape == data["next_obs"].shape == (160, 180)
    equal(data["obs"], expected["observations"])
    equal(data["next_obs"], expected["next_observations"])
    equal(data["action"], expected["actions"])
    equal(data["reward"], expected["rewards"][:, None])
    equal(data["done"], expected["truncated"][:, None].astype(np.float32))
    index = np.insert(data["index"], 0, 0)
    samples = {key: array[: int(index[num])] for key, array in data.items() if key != "index"}
    assert index[:num].tolist() == [0, 40, 80, 120][:num]
    assert all(len(array) == 40 * num for array in samples.values())
    assert samples["done"][-1] == 1


def test_neorls_reward_is_that_of_its_own_reward_function(dataset, tmp_path):
    """-(3·fatigue + consumption) of the newest frame of the next observation, entries 4 and 5."""
    data = np.load(ibdata.export(dataset, "neorl", tmp_path / "made", split="target", verify=True).path)
    fatigue, consumption = data["next_obs"][:, 4].astype(float), data["next_obs"][:, 5].astype(float)
    bound = 2.0**-23 * (abs(consumption) + 3 * abs(fatigue) + abs(data["reward"][:, 0]))
    assert (abs(data["reward"][:, 0] + 3 * fatigue + consumption) <= bound).all()
    equal(data["obs"][1, 6:], data["obs"][0, :-6])


def test_neorl_has_one_setpoint_and_rows_that_float32_can_count(dataset, tmp_path, monkeypatch):
    with pytest.raises(UsageError, match="neorl: found the setpoints 20, 70, expected one setpoint; use"):
        ibdata.export(dataset, "neorl", tmp_path / "made", verify=True)
    monkeypatch.setattr(neorl, "MAX_ROWS", 159)
    with pytest.raises(UsageError, match="neorl: found 160 rows, expected at most 159"):
        ibdata.export(dataset, "neorl", tmp_path / "made", split="target", verify=True)
    assert np.float32(2**24) == np.float32(2**24 + 1)
    assert list(tmp_path.iterdir()) == []


@cases
def test_d3rlpys_file_has_a_row_more_an_episode(dataset, plain, tmp_path, split, history, scale):
    options = {"split": split, "history": history, "reward_scale": scale}
    made = ibdata.export(dataset, "d3rlpy", tmp_path / "made", **options, verify=True)
    expected = plain(split, history, scale)
    with h5py.File(made.path) as file:
        assert file["num_episodes"][()] == made.episodes
        assert [key.decode() for key in file["columns"][()]] == list(d3rlpy.KEYS)
        assert len(file) == 3 + 4 * made.episodes
        for i in range(made.episodes):
            rows = slice(40 * i, 40 * i + 40)
            observations = file[f"observations_{i}"][()]
            equal(observations[:-1], expected["observations"][rows])
            equal(observations[1:], expected["next_observations"][rows])
            equal(file[f"actions_{i}"][:-1], expected["actions"][rows])
            equal(file[f"rewards_{i}"][:-1, 0], expected["rewards"][rows])
            assert file[f"rewards_{i}"].shape == (41, 1)
            assert file[f"rewards_{i}"][-1] == 0
            assert file[f"terminated_{i}"][()] is np.False_


@cases
def test_rllibs_file_has_vectors_and_no_text(dataset, plain, tmp_path, split, history, scale):
    options = {"split": split, "history": history, "reward_scale": scale}
    made = ibdata.export(dataset, "rllib", tmp_path / "made", **options, verify=True)
    table = pq.read_table(tmp_path / "made" / "arrays.parquet")
    expected = plain(split, history, scale)
    for name, key, width in (
        ("observation", "observations", 6 * history),
        ("action", "actions", 3),
        ("next_observation", "next_observations", 6 * history),
    ):
        assert str(table.schema.field(name).type) == f"fixed_size_list<element: float>[{width}]"
        equal(np.stack(table[name].to_numpy()), expected[key])
    for name in ("episode", "step", "terminated", "truncated"):
        equal(table[name].to_numpy(), expected[name])
    equal(table["reward"].to_numpy(), expected["rewards"])
    assert len(table.column_names) == 8
    assert not any("string" in str(field.type) for field in table.schema)
    assert f"input_=['{tmp_path}/made/arrays.parquet']" in made.snippet


def test_rllibs_file_may_be_named(dataset, tmp_path):
    ibdata.export(dataset, "rllib", tmp_path / "mine.parquet", verify=True)
    assert pq.read_metadata(tmp_path / "mine.parquet").num_rows == 480


@pytest.mark.parametrize("name", ["made", "made.csv", "made.csv.gz"])
def test_csv_gives_every_float_again(dataset, tmp_path, name):
    made = ibdata.export(dataset, "csv", tmp_path / name, verify=True)
    found = pd.read_csv(made.path, engine="pyarrow")
    expected = dataset.to_pandas()
    assert list(found.columns) == list(expected.columns)
    for column in expected.columns:
        if expected[column].dtype == np.float64:
            equal(found[column].astype("float64"), expected[column])
        else:
            assert found[column].tolist() == expected[column].tolist()


def test_the_snippet_of_csv_reads_labels_as_they_are(tmp_path):
    labels = ["nan", "007", "null", "true", "1e5", "2020-01-01", "na"]
    policies = [
        {"kind": "constant", "action": [0, i / 8, 0], "name": label} for i, label in enumerate(labels)
    ]
    experiment = Experiment(name="x", setpoints=70, policies=policies, steps=3)
    dataset = ibdata.generate(experiment, tmp_path / "data", workers=1)
    names: dict = {}
    for history in (1, 2):
        made = ibdata.export(dataset, "csv", tmp_path / f"{history}.csv", history=history, verify=True)
        exec(made.snippet, names)
        expected = dataset.to_pandas()
        assert names["data"]["policy"].tolist() == expected["policy"].tolist()
        for column in expected.columns.drop("policy"):
            equal(names["data"][column].astype(expected[column].dtype), expected[column])


def test_csv_of_float32_gives_every_float_again_with_its_history(tmp_path):
    experiment = ibdata.load("random.yaml", ["setpoints=70", "steps=60"])
    dataset = ibdata.generate(experiment, tmp_path / "data", workers=1)
    made = ibdata.export(dataset, "csv", tmp_path / "made.csv", history=3, reward_scale=0.01, verify=True)
    found = pd.read_csv(made.path, engine="pyarrow")
    expected = dataset.to_pandas()
    for column in expected.columns.drop(["reward", "policy", "terminated", "truncated"]):
        equal(found[column].astype(expected[column].dtype), expected[column])
    equal(found["reward"].astype("float32"), (expected["reward"].astype(float) * 0.01).astype("float32"))
    history = dataset.arrays(history=3)
    for i, lagged in enumerate(found.columns[-24:]):
        group = "observations" if i < 12 else "next_observations"
        assert lagged.startswith("obs_" if i < 12 else "next_obs_")
        assert lagged.endswith(f"_lag_{1 + i % 12 // 6}")
        equal(found[lagged].astype("float32"), history[group][:, 6 + i % 12])


def test_the_snippets_of_files_run(dataset, tmp_path):
    for to, size in (("npz", 480), ("d4rl", 480), ("neorl", 160), ("csv", 480)):
        made = ibdata.export(
            dataset, to, tmp_path / to, split="target" if to == "neorl" else None, verify=True
        )
        names: dict = {}
        exec(made.snippet, names)
        data = names["data"]
        assert len(data["reward" if to in ("neorl", "csv") else "rewards"]) == size
        if to == "neorl":
            assert data["index"].tolist() == [0, 40, 80, 120]
