"""What an export of a view says of itself, and what is exported beside a view."""

import json
import zipfile

import h5py
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from exporters.reading import equal, hdf5, holds

import ibdata

TROUBLES = {
    "imperfections": {
        "delay": {"obs_fatigue": 3},
        "noise": {"obs_consumption": 2.0},
        "missing": {"obs_velocity": 0.2},
        "mask": True,
    },
    "reward": "delta",
}
VIEWS = {
    "markov": {"observe": "markov", "actions": True, "reward": {"consumption": 1, "fatigue": 1}},
    "troubles": TROUBLES,
}


def said(made):
    """What an export says of itself."""
    if made.format in ("npz", "neorl"):
        return json.loads(zipfile.ZipFile(made.path).comment)
    if made.format in ("d3rlpy", "d4rl"):
        with h5py.File(made.path) as file:
            return json.loads(file.attrs["view"])
    return json.loads(pq.read_schema(made.path).metadata[b"view"])


@pytest.mark.parametrize("view", VIEWS.values(), ids=VIEWS)
@pytest.mark.parametrize("to", ["npz", "neorl", "d3rlpy", "d4rl", "rllib"])
def test_an_export_says_what_it_shows(dataset, tmp_path, to, view):
    out = tmp_path / ("made.parquet" if to == "rllib" else "made")
    made = ibdata.export(dataset, to, out, history=3, split="target", view=view)
    found = said(made)
    assert tuple(found["frame"]) == made.frame == dataset.windows(view=view).frame
    assert (found["history"], found["split"], found["content_root"]) == (3, "target", dataset.content_root)
    assert found["reward"] == view["reward"]
    assert ("episodes" in found) == bool(found["imperfections"])
    assert found["imperfections"].get("delay") == view.get("imperfections", {}).get("delay")


@pytest.mark.parametrize("to", ["npz", "d4rl", "csv"])
def test_the_true_values_of_imperfect_measurements_stay_beside(dataset, tmp_path, to):
    made = ibdata.export(dataset, to, tmp_path / "made", view=TROUBLES)
    readers = {"npz": lambda path: dict(np.load(path)), "d4rl": hdf5, "csv": pd.read_csv}
    found = readers[to](made.path)
    name = "clean_obs_fatigue" if to == "csv" else "infos/clean_obs_fatigue"
    equal(found[name], dataset.table(["obs_fatigue"])["obs_fatigue"].to_numpy())


def test_rows_without_a_next_frame_are_left_out_and_counted(tmp_path, to):
    given = {"name": "x", "setpoints": 20, "policies": ["random"], "episodes": 4, "steps": 9}
    dataset = ibdata.generate(given, tmp_path / "data", workers=1)
    made = ibdata.export(dataset, to, tmp_path / "made", history=2, view={"observe": "markov"})
    assert (made.rows, made.episodes, made.left_out) == (32, 4, 4)
    holds(made, dataset, history=2, view={"observe": "markov"})
