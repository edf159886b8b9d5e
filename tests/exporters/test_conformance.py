"""Exports hold every value, say what they show, refuse invalid arguments, and are read as each format is."""

import json
import sys
import zipfile
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from exporters.reading import equal, hdf5, holds, one_setpoint

import ibdata
from ibdata.cli import cli
from ibdata.dataset.stored import Stored
from ibdata.errors import DatasetError, IbdataError, UsageError
from ibdata.exporters import neorl
from ibdata.exporters._source import Source

VIEWS = {
    "hidden": (1, {"observe": "markov", "imperfections": {"missing": {"latent_mu_v": 0.2}}}),
    "markov": (4, {"observe": "markov", "actions": True, "reward": {"consumption": 1, "fatigue": 1}}),
    "troubles": (
        3,
        {
            "imperfections": {"delay": {"obs_fatigue": 3}, "missing": {"obs_velocity": 0.2}, "mask": True},
            "reward": "delta",
            "reward_scale": 0.1,
        },
    ),
}


@pytest.mark.parametrize(("history", "view"), VIEWS.values(), ids=VIEWS)
def test_every_value_of_the_arrays_is_there_again(dataset, tmp_path, to, history, view, monkeypatch):
    """And the export says what it shows; blocks of any size give the same values."""
    monkeypatch.setattr("ibdata.exporters._source.BLOCK_ROWS", 30 if history == 3 else 10**6)
    made = ibdata.export(dataset, to, tmp_path / "made", split="target", history=history, view=view)
    assert (made.format, made.rows, made.episodes) == (to, 160, 4)
    holds(made, dataset, "target", history, view=view)
    if (found := said(made)) is None:
        return
    assert tuple(found["frame"]) == made.frame == dataset.windows(view=view).frame
    assert (found["history"], found["split"], found["content_root"]) == (
        history,
        "target",
        dataset.content_root,
    )
    assert found["reward"] == view.get("reward", "classic")
    assert ("episodes" in found) == bool(found["imperfections"])
    assert found["imperfections"].get("delay") == view.get("imperfections", {}).get("delay")


def costs_in_minari(path):
    from minari import MinariDataset

    return np.concatenate([one.infos["cost"][:-1, 0] for one in MinariDataset(Path(path) / "data")])


COSTS = {  # where a format has them
    "csv": lambda path: pd.read_csv(path)["cost"],
    "d4rl": lambda path: hdf5(path)["costs"],
    "lerobot": lambda path: pq.read_table(f"{path}/data")["next.cost"],
    "minari": costs_in_minari,
    "npz": lambda path: np.load(path)["costs"],
}


def test_costs_have_a_place_or_are_refused(dataset, tmp_path, to):
    view = {"cost": {"fatigue": 20}}
    if to not in COSTS:
        with pytest.raises(UsageError, match=f"^cost: found one, but the format {to} has no place for costs"):
            ibdata.export(dataset, to, tmp_path / "made", split=one_setpoint(to), view=view)
        return
    made = ibdata.export(dataset, to, tmp_path / "made", view=view)
    costs = dataset.arrays(view=view)["costs"]
    assert 0 < costs.sum() < len(costs)
    assert np.array(COSTS[to](made.path)).ravel().tolist() == costs.tolist()


def test_a_block_is_bounded_and_holds_whole_episodes(dataset, monkeypatch):
    """So memory does not grow with the dataset: at most the rows asked for and one episode more."""
    monkeypatch.setattr("ibdata.exporters._source.BLOCK_ROWS", 60)
    for history, limit in ((1, 60), (3, 20)):
        blocks = list(Source(dataset.select(), history=history).blocks())
        assert sum(len(block["rewards"]) for block in blocks) == 480
        assert all(len(block["rewards"]) <= limit + 40 for block in blocks)
        assert all(block["step"][0] == 0 and block["truncated"][-1] for block in blocks)
    assert [len(block["rewards"]) for block in Source(dataset.select()).episode_blocks()] == [40] * 12


def test_it_says_what_it_made_and_leaves_nothing_beside_it(dataset, tmp_path, to):
    out = tmp_path / "new" / "folder" / "made"
    made = ibdata.export(dataset, to, out, split=one_setpoint(to), view={"reward_scale": 0.5})
    holds(made, dataset, one_setpoint(to), made.history, view={"reward_scale": 0.5})
    assert made.reward_scale == 0.5
    assert (made.rows, made.episodes) == ((160, 4) if to == "neorl" else (480, 12))
    assert made.history == (30 if to == "neorl" else 1)
    assert Path(made.path).exists()
    compile(made.snippet, to, "exec")
    assert [path.name for path in out.parent.iterdir()] == ["made"]
    assert not list(tmp_path.rglob(".*"))


def test_the_command_prints_the_snippet_or_one_json_document(dataset, tmp_path):
    def run(*args):
        return CliRunner().invoke(cli, ["export", str(dataset.path), "--to", "csv", "--out", *map(str, args)])

    text, document = run(tmp_path / "a"), run(tmp_path / "b", "--json")
    assert (text.exit_code, text.stderr, document.exit_code, document.stderr) == (0, "", 0, "")
    made = json.loads(document.stdout)
    said = {"version", "format", "path", "episodes", "rows", "history", "reward_scale", "snippet"}
    assert set(made) == {*said, "frame", "left_out"}
    assert made["version"] == 1
    assert made["snippet"].replace(f"{tmp_path}/b", f"{tmp_path}/a") in text.stdout
    assert run(tmp_path / "b", "--overwrite").exit_code == 0


REFUSED = [
    ({"to": "mnari"}, "format: found 'mnari'; did you mean 'minari'"),
    ({"history": 0}, "history: found 0, expected a whole number of at least 1"),
    ({"view": {"reward_scale": 0.0}}, "reward_scale: found 0.0, expected a finite number above 0"),
    ({"view": {"obsreve": 1}}, "obsreve: no such option; did you mean 'observe'"),
    ({"view": "markov"}, "view: found 'markov', expected a mapping or None"),
    ({"id": "ib/x-v0"}, "id: found 'ib/x-v0', but the format npz has no ids; leave it out"),
    ({"history": 10**9}, "made: out of memory; use a smaller history, or one split"),
]


def test_options_that_cannot_be_meant(dataset, tmp_path):
    for options, message in REFUSED:
        with pytest.raises(IbdataError, match=message):
            ibdata.export(dataset, **{"to": "npz", "out": tmp_path / "made", **options})
    assert list(tmp_path.iterdir()) == []


def test_a_damaged_dataset_is_refused(dataset, tmp_path, monkeypatch):
    cut = dataset.table().slice(0, 90).to_batches()
    monkeypatch.setattr(Stored, "batches_of", lambda _, mask, names, most: (b.select(names) for b in cut))
    with pytest.raises(DatasetError, match="the last episode has no end, see ibdata validate"):
        ibdata.export(dataset, "npz", tmp_path / "made")
    assert list(tmp_path.iterdir()) == []


def test_a_library_that_is_not_installed_is_named_with_its_extra(dataset, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    line = r"exporting to d4rl needs the package h5py: pip install h5py, or 'ibdata\[hdf5\]'"
    with pytest.raises(ImportError, match=line):
        ibdata.export(dataset, "d4rl", tmp_path / "a" / "made")
    assert list(tmp_path.iterdir()) == []


def said(made):
    """What an export says of itself; None in a format that has no place for it, or is tested elsewhere."""
    if made.format in ("csv", "minari"):
        return None
    if made.format in ("npz", "neorl"):
        return json.loads(zipfile.ZipFile(made.path).comment)
    if made.format in ("d3rlpy", "d4rl"):
        with h5py.File(made.path) as file:
            return json.loads(file.attrs["view"])
    file = next(path for path in Path(made.path).rglob("*.parquet") if "meta" not in path.parts)
    return json.loads(pq.read_schema(file).metadata[b"view"])


@pytest.mark.parametrize("to", ["npz", "d4rl", "csv"])
def test_the_true_values_of_imperfect_measurements_stay_beside(dataset, tmp_path, to):
    made = ibdata.export(dataset, to, tmp_path / "made", view=VIEWS["troubles"][1])
    exact = partial(pd.read_csv, engine="pyarrow")  # older versions of pandas round by themselves
    readers = {"npz": lambda path: dict(np.load(path)), "d4rl": hdf5, "csv": exact}
    found = readers[to](made.path)
    name = "clean_obs_fatigue" if to == "csv" else "infos/clean_obs_fatigue"
    equal(found[name], dataset.table(["obs_fatigue"])["obs_fatigue"].to_numpy())


def test_rows_without_a_next_frame_are_left_out_and_counted(tmp_path, to):
    given = {"name": "x", "setpoints": 20, "policies": ["random"], "episodes": 4, "steps": 9}
    dataset = ibdata.generate(given, tmp_path / "data", workers=1)
    made = ibdata.export(dataset, to, tmp_path / "made", history=2, view={"observe": "markov"})
    assert (made.rows, made.episodes, made.left_out) == (32, 4, 4)
    holds(made, dataset, history=2, view={"observe": "markov"})


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


@pytest.mark.parametrize(("form", "reward"), [("npz", "rewards"), ("d4rl", "rewards"), ("neorl", "reward")])
def test_the_snippets_of_files_run(dataset, tmp_path, form, reward):
    names = {}
    exec(ibdata.export(dataset, form, tmp_path / form, split="target").snippet, names)
    assert len(names["data"][reward]) == 160
    assert form != "neorl" or names["data"]["index"].tolist() == [0, 40, 80, 120]
