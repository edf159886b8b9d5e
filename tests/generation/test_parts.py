"""A shard is made, and read again, in the parts in which it is simulated, however large its file is."""

import numpy as np
import pyarrow.parquet as pq
import pytest

import ibdata
from ibdata.dataset import statistics
from ibdata.experiment.rollout import Columns, rollout
from ibdata.generation import pieces as columns
from ibdata.generation import shard
from ibdata.tools import checks


@pytest.fixture
def experiment(describe):
    """30 episodes of 20 steps in one shard."""
    return describe(steps=20, episodes=15, policies=[{"kind": "safe"}])


@pytest.fixture
def small_parts(monkeypatch):
    """Parts of 8 episodes, 160 rows, and row groups of 100 rows."""

    def shrink():
        monkeypatch.setattr("ibdata.experiment.rollout.LANES", 8)
        monkeypatch.setattr("ibdata.experiment.rollout.PART_ROWS", 200)
        monkeypatch.setattr(shard, "ROW_GROUP_ROWS", 100)

    return shrink


def test_parts_do_not_change_a_dataset(experiment, small_parts, monkeypatch, tmp_path):
    """Only the row groups of its file; quantiles of a sample are of the same rows."""
    monkeypatch.setattr(statistics, "SAMPLE_ROWS", 90)
    monkeypatch.setattr(statistics, "SAMPLE_LEAST", 1)
    whole = ibdata.generate(experiment, tmp_path / "whole", workers=1)
    small_parts()
    made = ibdata.generate(experiment, tmp_path / "parts", workers=1)
    assert made.content_root == whole.content_root
    assert made.table().equals(whole.table())
    for name, described in whole.statistics().items():
        found = made.statistics()[name]
        assert found.pop("quantiles") == described.pop("quantiles")
        assert found == pytest.approx(described, rel=1e-9, abs=1e-9)
    np.testing.assert_allclose(made.episodes["return"], whole.episodes["return"], rtol=1e-12)
    (path,) = (made.path / "data").iterdir()
    groups = pq.ParquetFile(path).metadata
    sizes = [groups.row_group(i).num_rows for i in range(groups.num_row_groups)]
    assert sizes == [100, 60, 100, 60, 100, 60, 100, 20]
    assert columns.ROW_GROUP_ROWS == 100_000


PART = 400  # rows
USES = {
    "validate": ibdata.validate,
    "materialize": lambda folder: ibdata.split(folder, by="policy", materialize=folder.parent / "copy"),
    "repair": lambda folder: ((folder / "meta/statistics.json").unlink(), ibdata.repair(folder, workers=1)),
    "reproduce": ibdata.reproduce,
}


def test_few_rows_are_held_at_a_time(describe, tmp_path, monkeypatch):
    monkeypatch.setattr("ibdata.experiment.rollout.LANES", 10)
    monkeypatch.setattr("ibdata.experiment.rollout.PART_ROWS", PART)
    made = ibdata.generate(describe(episodes=50), tmp_path / "made", workers=1)
    assert len(made.manifest["shards"]) == 1
    held = []

    def seen(real):
        def noted(*args):
            found = real(*args)
            held.append(found.table.shape[1])
            return found

        return noted

    monkeypatch.setattr(checks, "PIECE_ROWS", PART)
    monkeypatch.setattr(columns, "Columns", seen(Columns))
    monkeypatch.setattr("ibdata.generation.pieces.rollout", seen(rollout))
    for name, use in USES.items():
        held.clear()
        use(made.path)
        assert sum(held) == len(made) * (2 if name == "repair" else 1), name  # which validates too
        assert max(held) <= PART, name
