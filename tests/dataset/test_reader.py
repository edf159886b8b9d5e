"""Reading a dataset: tables, batches, and arrays with histories."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from helpers import python

import ibdata
from ibdata.errors import UsageError

pytestmark = pytest.mark.portable

OBSERVATION = ("setpoint", "velocity", "gain", "shift", "fatigue", "consumption")
SPLITS = {None: 480, "target": 160}
splits = pytest.mark.parametrize("split", SPLITS)

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


@splits
def test_a_table_holds_the_rows_of_the_files_in_order(dataset, split):
    table = dataset.table(split=split)
    shards = dataset.manifest["shards"]
    paths = [shard["path"] for shard in shards if split is None or split in shard["splits"]]
    parts = [pq.read_table(dataset.path / "data" / Path(path).name) for path in paths]
    assert table.num_rows == SPLITS[split]
    assert table.to_pylist() == pa.concat_tables(parts).to_pylist()
    assert dataset.to_pandas(split=split).reset_index(drop=True).equals(table.to_pandas())


@splits
def test_batches_are_the_rows_in_order_and_not_too_long(dataset, split):
    for batch_rows in (1, 33, 2**70):
        batches = list(dataset.iter_batches(["episode", "step", "reward"], split, batch_rows))
        assert max(batch.num_rows for batch in batches) <= min(batch_rows, 80)
        made = pa.Table.from_batches(batches)
        assert made.equals(dataset.table(["episode", "step", "reward"], split).cast(made.schema))


def stacked_naively(rows, prefix, i, history):
    """The newest frame of row i from its own columns, older ones from the rows before it."""
    frames = [rows[i][f"{prefix}{name}"] for name in OBSERVATION]
    t = rows[i]["step"]
    older = range(1, history) if prefix == "obs_" else range(history - 1)
    for lag in older:
        frames += [rows[i - min(lag, t)][f"obs_{name}"] for name in OBSERVATION]
    return frames


@pytest.mark.parametrize(("history", "split"), [(1, "target"), (3, None), (50, "target")])
def test_histories_are_newest_first_and_of_one_episode(dataset, history, split):
    arrays = dataset.arrays(history, split)
    rows = dataset.table(split=split).to_pylist()
    assert arrays["observations"].shape == arrays["next_observations"].shape == (SPLITS[split], 6 * history)
    assert arrays["observations"].dtype == np.float32
    for i in range(SPLITS[split]):
        assert arrays["observations"][i].tolist() == stacked_naively(rows, "obs_", i, history)
        assert arrays["next_observations"][i].tolist() == stacked_naively(rows, "next_obs_", i, history)


def test_rows_without_a_full_history_can_be_left_out(dataset):
    whole, padded = dataset.arrays(4, "target", pad="drop"), dataset.arrays(4, "target")
    kept = padded["step"] >= 3
    assert list(whole) == list(padded)
    assert len(whole["rewards"]) < len(padded["rewards"])
    for name, array in whole.items():
        np.testing.assert_array_equal(array, padded[name][kept])
    assert len(dataset.arrays(1, pad="drop")["rewards"]) == 480


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
    (lambda d: d.head(at=(99, 0)), "at: found"),
    (lambda d: d.head(at=(0, 40)), "at: found"),
    (lambda d: d.head(at=3), "at: found"),
    (lambda d: d.head(at=(0, 0), split="target"), "at: found"),
]


def test_options_that_cannot_be_meant_are_refused(dataset):
    for read, line in REFUSED:
        with pytest.raises(UsageError, match=line):
            read(dataset)


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


TYPES = {"episode": np.int64, "step": np.int32, "truncated": np.bool_, "terminated": np.bool_}
TYPES |= dict.fromkeys(["obs_fatigue", "reward", "latent_mu_v"])
FATIGUE = 40.0


def test_pandas_finds_the_values_of_ibdata_bit_for_bit(either):
    """And a filter keeps the right rows, whatever it takes from the statistics of a file."""
    rows, table = pd.read_parquet(either.path / "data"), either.table()
    filters = [("obs_setpoint", ">", 60), ("obs_fatigue", ">", FATIGUE)]
    filtered = pd.read_parquet(either.path / "data", filters=filters)
    assert list(rows.columns) == table.column_names
    kept = (table["obs_setpoint"].to_numpy() > 60) & (table["obs_fatigue"].to_numpy() > FATIGUE)
    assert 10 < kept.sum() < 300
    for name, dtype in TYPES.items():
        expected = table[name].to_numpy()
        assert rows[name].dtype == expected.dtype == (dtype or expected.dtype)
        assert rows[name].to_numpy().tobytes() == expected.tobytes()
        assert filtered[name].to_numpy().tobytes() == expected[kept].tobytes()
    assert rows["policy"].tolist() == table["policy"].to_pylist()
