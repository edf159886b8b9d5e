"""Exports hold every value, say what they show, refuse invalid arguments, and are read as each format is."""

import json
import sys

import numpy as np
import pytest
from click.testing import CliRunner
from exporters.export_tests import ExportTests
from exporters.reading import equal, ran, read

import ibdata
from ibdata.cli import cli
from ibdata.dataset.stored import Stored
from ibdata.errors import DatasetError, IbdataError, UsageError
from ibdata.exporters import FORMATS, neorl
from ibdata.exporters._source import Source

ELSEWHERE = ("minari",)  # tested where its library is, see tests/bridges


class TestFiles(ExportTests):
    """Every format, by the form of its files; tests/bridges has libraries that read them."""

    read = staticmethod(read)

    @pytest.fixture(params=[name for name in FORMATS if name not in ELSEWHERE])
    def to(self, request):
        return request.param


def test_a_block_is_bounded_and_holds_whole_episodes(dataset, small_blocks):
    """So memory does not grow with the dataset: at most the rows asked for and one episode more."""
    small_blocks(exported_rows=60)
    for history, limit in ((1, 60), (3, 20)):
        blocks = list(Source(dataset.select(), history=history).blocks())
        assert sum(len(block["rewards"]) for block in blocks) == 480
        assert all(len(block["rewards"]) <= limit + 40 for block in blocks)
        assert all(block["step"][0] == 0 and block["truncated"][-1] for block in blocks)
    assert [len(block["rewards"]) for block in Source(dataset.select()).episode_blocks()] == [40] * 12


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


def test_neorls_loader_finds_the_trajectories(dataset, tmp_path):
    """By the rules of its loader: a 0 in front of index, then the rows before index[num]."""
    made = ibdata.export(dataset, "neorl", tmp_path / "made", split="target")
    data = dict(np.load(made.path))
    assert set(data) == {"obs", "next_obs", "action", "reward", "done", "index"}
    assert data["obs"].shape == data["next_obs"].shape == (160, 180)
    assert data["reward"].shape == data["done"].shape == (160, 1)
    index = np.insert(data["index"], 0, 0)
    assert index[:4].tolist() == ran(made)["data"]["index"].tolist() == [0, 40, 80, 120]
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
