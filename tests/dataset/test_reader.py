"""Reading a dataset: what it is, rows from one on, files that pandas reads, and what is refused."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from helpers import python
from helpers.refusals import refused

import ibdata

pytestmark = pytest.mark.portable

ONLY_READING = """
import sys, ibdata
from ibdata.cli import cli
dataset = ibdata.open(sys.argv[1])
len(dataset), repr(dataset), dataset.info, dataset.statistics(), dataset.table(split="source")
list(dataset.iter_batches()), dataset.arrays(history=3)
dataset.episodes, dataset.to_pandas()
cli.main(["info", sys.argv[1]], standalone_mode=False)
loaded = [name for name in sys.modules if name.startswith(("numba", "ibdata.policies", "ibdata.dynamics"))]
assert not loaded, loaded
"""


def test_a_dataset_says_what_it_is(dataset, monkeypatch):
    assert len(dataset) == 480
    assert repr(dataset) == f"<ibdata.Dataset {dataset.path}: 480 rows, 12 episodes>"
    monkeypatch.setattr(type(dataset.stored), "name", "a\x1b[2J")
    assert "\x1b" not in repr(dataset)
    assert dataset.manifest == json.loads((dataset.path / "meta/manifest.json").read_text())
    assert dataset.content_root == dataset.manifest["content_root"]
    assert dataset.info == json.loads((dataset.path / "meta/dataset.json").read_text())
    frame = dataset.episodes
    frame["episode"] = 0
    assert dataset.episodes["episode"].tolist() == list(range(12))


def test_batches_are_not_too_long(dataset):
    for batch_rows in (1, 33, 2**70):
        counts = [batch.num_rows for batch in dataset.iter_batches(["step"], batch_rows=batch_rows)]
        assert (sum(counts), max(counts) <= min(batch_rows, 80)) == (480, True)


def test_head_reads_on_from_a_row_to_the_end(dataset):
    frame = dataset.to_pandas()
    for at in ((0, 0), (3, 11), (11, 31)):
        first = int(np.flatnonzero((frame["episode"] == at[0]) & (frame["step"] == at[1]))[0])
        found = dataset.head(40, at=at).to_pandas(ignore_metadata=True)
        assert found.equals(frame.iloc[first : first + 40].reset_index(drop=True))
        assert dataset.head(2**70, at=at).num_rows == len(frame) - first
    assert dataset.head(2**70, ["reward"]).num_rows == len(frame)


REFUSED = [
    (lambda d: list(d.iter_batches(batch_rows=0)), "batch_rows: found 0, expected a whole number"),
    (lambda d: d.arrays(-3), "history: found -3, expected a whole number of at least 1"),
    (lambda d: d.arrays(2, pad="zero"), "pad: found 'zero', expected repeat or drop"),
    (
        lambda d: d.arrays(view={"observe": ["latent_penalty"]}),
        "observe: found latent_penalty, expected columns of",
    ),
    (
        lambda d: d.arrays(view={"observe": ["latent_drift_rate"]}),
        "observe: found latent_drift_rate, expected",
    ),
    (
        lambda d: d.iter_batches(["reward"], view={"observe": "markov"}),
        "columns: found columns beside a view",
    ),
    (lambda d: d.head(at=(99, 0)), "at: found"),
    (lambda d: d.head(at=(0, 40)), "at: found"),
    (lambda d: d.head(at=3), "at: found"),
    (lambda d: d.head(at=(0, 0), split="target"), "at: found"),
]


def test_options_that_cannot_be_meant_are_refused(dataset):
    for read, line in REFUSED:
        refused(line, read, dataset)


def test_files_that_the_manifest_does_not_list_are_not_read(copied, dataset):
    pq.write_table(dataset.table().slice(0, 7), copied / "data/part-00099.parquet")
    found = ibdata.open(copied)
    assert found.table().equals(dataset.table())
    assert sum(batch.num_rows for batch in found.iter_batches()) == len(found) == 480


@pytest.mark.skipif(os.name == "nt", reason="Windows makes links for administrators only")
def test_files_may_be_links_as_in_the_cache_of_the_hub(dataset, tmp_path):
    """`hf download` without --local-dir gives such a folder. A split that is made there stays there."""
    stored, linked = Path(shutil.copytree(dataset.path, tmp_path / "blobs")), tmp_path / "snapshot"
    for path in [path for path in stored.rglob("*") if path.is_file()]:
        link = linked / path.relative_to(stored)
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(path)
    before = (stored / "meta/splits.json").read_bytes()
    assert ibdata.validate(linked) == ibdata.repair(linked, workers=1) == []
    assert ibdata.open(linked).table().equals(dataset.table())
    assert "random" in ibdata.split(linked, {"random": {"policy": "random"}}).splits
    assert (stored / "meta/splits.json").read_bytes() == before


def test_reading_imports_neither_the_simulator_nor_a_policy(dataset):
    child = python("-W", "error", "-c", ONLY_READING, dataset.path, timeout=60)
    assert (child.returncode, child.stderr) == (0, "")


def test_a_filter_of_pandas_keeps_the_right_rows(either):
    """Whatever it takes from the statistics of a file."""
    filters = [("obs_setpoint", ">", 60), ("obs_fatigue", ">", 40.0)]
    found, rows = pd.read_parquet(either.path / "data", filters=filters), either.to_pandas()
    expected = rows[(rows["obs_setpoint"] > 60) & (rows["obs_fatigue"] > 40)]
    assert 10 < len(expected) < 300
    pd.testing.assert_frame_equal(found, expected.reset_index(drop=True), check_categorical=False)
