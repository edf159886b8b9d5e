"""What is special in each format, read by the format's own reader or by its rules."""

import h5py
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from exporters.reading import equal, hdf5, holds

import ibdata
from ibdata.errors import UsageError
from ibdata.exporters import d3rlpy, neorl


@pytest.mark.parametrize("to", ["npz", "d4rl"])
def test_npz_and_d4rl_hold_the_same_keys(dataset, tmp_path, to):
    made = ibdata.export(dataset, to, tmp_path / "made", split="target")
    data = dict(np.load(made.path)) if to == "npz" else hdf5(made.path)
    infos = {name.removeprefix("infos/"): array for name, array in data.items() if "/" in name}
    assert len(infos) == 2 + 14 + 14 + 1
    table = dataset.table(list(infos), split="target")
    for name, array in infos.items():
        equal(array, table[name].to_numpy())
    keys = {"observations", "actions", "rewards", "next_observations", "terminals", "timeouts"}
    assert {name for name in data if "/" not in name} == keys


def test_d4rl_has_an_entry_a_row_and_metadata_as_attributes(dataset, tmp_path):
    """D4RL's sequence_dataset takes every key at every row; a scalar there ends it."""
    made = ibdata.export(dataset, "d4rl", tmp_path / "made", view={"reward_scale": 0.01})
    data = hdf5(made.path)
    assert all(len(array) == 480 for array in data.values())
    assert data["rewards"].shape == data["terminals"].shape == (480,)
    with h5py.File(made.path) as file:
        assert file.attrs["content_root"] == dataset.content_root
        assert file.attrs["reward_scale"] == 0.01


@pytest.mark.parametrize("num", [1, 4])
def test_neorls_loader_finds_the_trajectories(dataset, tmp_path, num):
    """By the rules of its loader: a 0 in front of index, then the rows before index[num]."""
    made = ibdata.export(dataset, "neorl", tmp_path / "made", split="target")
    data = dict(np.load(made.path))
    assert set(data) == {"obs", "next_obs", "action", "reward", "done", "index"}
    assert data["obs"].shape == data["next_obs"].shape == (160, 180)
    assert data["reward"].shape == data["done"].shape == (160, 1)
    index = np.insert(data["index"], 0, 0)
    samples = {key: array[: int(index[num])] for key, array in data.items() if key != "index"}
    assert index[:num].tolist() == [0, 40, 80, 120][:num]
    assert all(len(array) == 40 * num for array in samples.values())
    assert samples["done"][-1] == 1


def test_neorls_reward_is_that_of_its_own_reward_function(dataset, tmp_path):
    """-(3·fatigue + consumption) of the newest frame of the next observation, entries 4 and 5."""
    data = np.load(ibdata.export(dataset, "neorl", tmp_path / "made", split="target").path)
    fatigue, consumption = data["next_obs"][:, 4].astype(float), data["next_obs"][:, 5].astype(float)
    bound = 2.0**-23 * (abs(consumption) + 3 * abs(fatigue) + abs(data["reward"][:, 0]))
    assert (abs(data["reward"][:, 0] + 3 * fatigue + consumption) <= bound).all()
    equal(data["obs"][1, 6:], data["obs"][0, :-6])


def test_neorl_has_one_setpoint_and_rows_that_float32_can_count(dataset, tmp_path, monkeypatch):
    with pytest.raises(UsageError, match="neorl: found the setpoints 20, 70, expected one setpoint; use"):
        ibdata.export(dataset, "neorl", tmp_path / "made")
    assert neorl.MAX_ROWS <= 2**24
    monkeypatch.setattr(neorl, "MAX_ROWS", 159)
    with pytest.raises(UsageError, match="neorl: found 160 rows, expected at most 159"):
        ibdata.export(dataset, "neorl", tmp_path / "made", split="target")
    assert list(tmp_path.iterdir()) == []


def test_d3rlpys_file_has_a_row_more_an_episode(dataset, tmp_path):
    made = ibdata.export(dataset, "d3rlpy", tmp_path / "made")
    with h5py.File(made.path) as file:
        assert file["num_episodes"][()] == 12
        assert [key.decode() for key in file["columns"][()]] == list(d3rlpy.KEYS)
        assert len(file) == 3 + 4 * 12
        for i in range(12):
            assert file[f"observations_{i}"].shape == (41, 6)
            assert file[f"actions_{i}"][-1].tolist() == [0.5] * 3
            assert file[f"rewards_{i}"].shape == (41, 1)
            assert file[f"rewards_{i}"][-1] == 0
            assert file[f"terminated_{i}"][()] is np.False_


def test_rllibs_file_has_vectors_and_no_text(dataset, tmp_path):
    made = ibdata.export(dataset, "rllib", tmp_path / "made", history=4)
    schema = pq.read_schema(tmp_path / "made" / "arrays.parquet")
    for name, width in (("observation", 24), ("action", 3), ("next_observation", 24)):
        assert str(schema.field(name).type) == f"fixed_size_list<element: float>[{width}]"
    assert len(schema.names) == 8
    assert not any("string" in str(field.type) for field in schema)
    assert f"input_=['{tmp_path}/made/arrays.parquet']" in made.snippet
    holds(ibdata.export(dataset, "rllib", tmp_path / "mine.parquet"), dataset)
    assert (tmp_path / "mine.parquet").is_file()


@pytest.mark.parametrize(("name", "dtype"), [("made.csv", "float32"), ("made.csv.gz", "float64")])
def test_csv_gives_every_float_again_with_its_history(dataset, tmp_path, name, dtype):
    if dtype == "float32":
        changes = ["setpoints=70", "steps=60"]
        dataset = ibdata.generate("random.yaml", tmp_path / "data", overrides=changes, workers=1)
    options = {"history": 3, "view": {"reward_scale": 0.01}} if dtype == "float32" else {}
    made = ibdata.export(dataset, "csv", tmp_path / name, **options)
    found, expected = pd.read_csv(made.path, engine="pyarrow"), dataset.to_pandas()
    older = [f"_lag_{lag}" for lag in range(1, made.history)]
    lags = [f"{prefix}{name}{lag}" for prefix in ("", "next_") for lag in older for name in made.frame]
    assert list(found.columns) == [*expected.columns, *lags]
    changed = ["reward"] if options else []
    for column in expected.columns.drop(["policy", *changed]):
        equal(found[column].astype(expected[column].dtype), expected[column])
    assert found["policy"].tolist() == expected["policy"].tolist()


def test_the_snippet_of_csv_reads_labels_as_they_are(tmp_path):
    labels = ["nan", "007", "true", "1e5", "2020-01-01"]
    policies = [
        {"kind": "constant", "action": [0, i / 8, 0], "name": label} for i, label in enumerate(labels)
    ]
    experiment = {"name": "x", "setpoints": 70, "policies": policies, "steps": 3}
    dataset = ibdata.generate(experiment, tmp_path / "data", workers=1)
    names, expected = {}, dataset.to_pandas()
    for history in (1, 2):
        exec(ibdata.export(dataset, "csv", tmp_path / f"{history}.csv", history=history).snippet, names)
        assert names["data"]["policy"].tolist() == expected["policy"].tolist()
        for column in expected.columns.drop("policy"):
            equal(names["data"][column].astype(expected[column].dtype), expected[column])


@pytest.mark.parametrize(
    ("to", "reward", "size"),
    [("npz", "rewards", 480), ("d4rl", "rewards", 480), ("neorl", "reward", 160), ("csv", "reward", 480)],
)
def test_the_snippets_of_files_run(dataset, tmp_path, to, reward, size):
    made = ibdata.export(dataset, to, tmp_path / to, split="target" if to == "neorl" else None)
    names = {}
    exec(made.snippet, names)
    assert len(names["data"][reward]) == size
    if to == "neorl":
        assert names["data"]["index"].tolist() == [0, 40, 80, 120]
