"""Views in each format, read by the format's own reader."""

from __future__ import annotations

import json
import zipfile

import h5py
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

import ibdata

TROUBLES = {
    "delay": {"obs_fatigue": 3},
    "noise": {"obs_consumption": 2.0},
    "missing": {"obs_velocity": 0.2},
    "mask": True,
}
VIEWS = {
    "markov": {"observe": "markov", "actions": True, "reward": {"consumption": 1, "fatigue": 1}},
    "troubles": {"imperfections": TROUBLES, "reward": "delta", "reward_scale": 0.1},
}
KEYS = {
    "npz": ("observations", "next_observations", "actions", "rewards", "timeouts"),
    "d4rl": ("observations", "next_observations", "actions", "rewards", "timeouts"),
    "neorl": ("obs", "next_obs", "action", "reward", "done"),
    "rllib": ("observation", "next_observation", "action", "reward", "truncated"),
}
WANTED = ("observations", "next_observations", "actions", "rewards", "truncated")


@pytest.fixture(params=VIEWS.values(), ids=VIEWS)
def view(request):
    return request.param


def read(made):
    """The arrays of an export, and what it says of itself."""
    if made.format in ("npz", "neorl"):
        return np.load(made.path), json.loads(zipfile.ZipFile(made.path).comment)
    if made.format == "d4rl":
        file = h5py.File(made.path)
        return file, json.loads(file.attrs["view"])
    table = pq.read_table(made.path)
    found = {name: np.stack(table[name].to_numpy(zero_copy_only=False)) for name in KEYS["rllib"]}
    return found, json.loads(table.schema.metadata[b"view"])


@pytest.mark.parametrize("to", KEYS)
def test_an_export_shows_what_the_arrays_show_and_says_so(dataset, tmp_path, to, view):
    history, split = 3, "target"
    made = ibdata.export(
        dataset, to, tmp_path / f"made{'.parquet' if to == 'rllib' else ''}",
        history=history, split=split, verify=True, **view,
    )  # fmt: skip
    found, said = read(made)
    expected = dataset.arrays(history, split, **view)
    for key, name in zip(KEYS[to], WANTED, strict=True):
        array = np.asarray(found[key])
        assert array.reshape(expected[name].shape).tolist() == expected[name].tolist()
    assert tuple(said["frame"]) == made.frame == dataset.windows(**view).frame
    assert (said["history"], said["split"], said["content_root"]) == (3, "target", dataset.content_root)
    assert said["reward"] == view["reward"]
    assert ("episodes" in said) == bool(said["imperfections"])
    assert said["imperfections"].get("delay") == view.get("imperfections", {}).get("delay")


def test_csv_has_a_column_for_each_number_of_a_frame(dataset, tmp_path, view):
    made = ibdata.export(dataset, "csv", tmp_path / "made.csv", history=2, verify=True, **view)
    found, expected = pd.read_csv(made.path), dataset.arrays(2, **view)
    for prefix, name in (("", "observations"), ("next_", "next_observations")):
        columns = [f"{prefix}{column}{lag}" for lag in ("", "_lag_1") for column in made.frame]
        assert (found[columns].to_numpy(np.float32) == expected[name]).all()
    assert (found["reward"].to_numpy(np.float32) == expected["rewards"]).all()
    assert len(set(found.columns)) == len(found.columns)


@pytest.mark.parametrize("to", ["npz", "d4rl", "csv"])
def test_the_true_values_of_imperfect_measurements_stay_beside(dataset, tmp_path, to):
    made = ibdata.export(dataset, to, tmp_path / "made", **VIEWS["troubles"])
    found = pd.read_csv(made.path) if to == "csv" else read(made)[0]
    name = "clean_obs_fatigue" if to == "csv" else "infos/clean_obs_fatigue"
    true = dataset.table(["obs_fatigue"])["obs_fatigue"].to_numpy()
    assert np.asarray(found[name]).astype(np.float32).tolist() == true.astype(np.float32).tolist()


def test_rows_without_a_next_frame_are_left_out_and_counted(tmp_path):
    given = {"name": "x", "setpoints": [20, 70], "policies": ["random"], "episodes": 2, "steps": 9}
    dataset = ibdata.generate(given, tmp_path / "data", workers=1)
    made = ibdata.export(dataset, "npz", tmp_path / "made", observe="markov", verify=True)
    assert (made.rows, made.episodes, made.left_out) == (32, 4, 4)
    assert np.flatnonzero(np.load(made.path)["timeouts"]).tolist() == [7, 15, 23, 31]
