"""What is special in each format, read by the format's own reader or by its rules."""

import numpy as np
import pandas as pd
import pytest
from exporters.reading import equal

import ibdata
from ibdata.errors import UsageError
from ibdata.exporters import neorl


def test_neorls_loader_finds_the_trajectories(dataset, tmp_path):
    """By the rules of its loader: a 0 in front of index, then the rows before index[num]."""
    made = ibdata.export(dataset, "neorl", tmp_path / "made", split="target")
    data = dict(np.load(made.path))
    assert set(data) == {"obs", "next_obs", "action", "reward", "done", "index"}
    assert data["obs"].shape == data["next_obs"].shape == (160, 180)
    assert data["reward"].shape == data["done"].shape == (160, 1)
    index = np.insert(data["index"], 0, 0)
    assert index[:4].tolist() == [0, 40, 80, 120]
    for num in (1, 4):
        samples = {key: array[: int(index[num])] for key, array in data.items() if key != "index"}
        assert all(len(array) == 40 * num for array in samples.values())
        assert samples["done"][-1] == 1


def test_neorl_has_one_setpoint_and_rows_that_float32_can_count(dataset, tmp_path, monkeypatch):
    with pytest.raises(UsageError, match="neorl: found the setpoints 20, 70, expected one setpoint; use"):
        ibdata.export(dataset, "neorl", tmp_path / "made")
    assert neorl.MAX_ROWS <= 2**24
    monkeypatch.setattr(neorl, "MAX_ROWS", 159)
    with pytest.raises(UsageError, match="neorl: found 160 rows, expected at most 159"):
        ibdata.export(dataset, "neorl", tmp_path / "made", split="target")
    assert list(tmp_path.iterdir()) == []


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
