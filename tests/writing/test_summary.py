"""A shard that is written in parts has the same file and content as one written at once."""

from __future__ import annotations

import hashlib
import threading
import time
from contextlib import contextmanager

import numpy as np
import pyarrow.parquet as pq
import pytest

from ibdata.dataset import statistics
from ibdata.dataset.statistics import moments
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import plan
from ibdata.experiment.rollout import parts, rollout
from ibdata.writing import arrow, shard_writer, summary
from ibdata.writing.summary import describe

STEPS, EPISODES = 20, 30


@pytest.fixture
def made(describe, monkeypatch):
    """An experiment of one shard in parts of 8 episodes, 160 rows, and row groups of 100 rows."""
    monkeypatch.setattr("ibdata.experiment.rollout.LANES", 8)
    monkeypatch.setattr("ibdata.experiment.rollout.PART_ROWS", 200)
    monkeypatch.setattr(shard_writer, "ROW_GROUP_ROWS", 100)
    experiment = describe(steps=STEPS, episodes=EPISODES // 2, policies=[{"kind": "safe"}])
    [whole] = plan(experiment)
    return DatasetSpec.of(experiment), whole


@contextmanager
def opened(spec, shard, folder):
    with (
        shard_writer.writing_threads() as threads,
        shard_writer.shard_writer(spec, shard, folder, threads) as w,
    ):
        yield w


def write(spec, shard, folder):
    with opened(spec, shard, folder) as writer:
        for part, floats in summary.simulated(spec, shard):
            writer.add(part, floats)
        return writer.finish()


def test_parts_are_whole_blocks(made):
    spec, whole = made
    assert [*parts(spec.of_shard(whole), 5, 30)] == [(5, 13), (13, 21), (21, 29), (29, 30)]


def test_parts_of_long_episodes_have_some_lanes(made):
    spec, whole = made
    longer = spec.of_shard(whole).model_copy(update={"steps": 10**6})
    assert [*parts(longer, 0, 100)] == [(0, 64), (64, 100)]


def test_the_file_holds_the_table_in_one_piece(made, tmp_path):
    spec, whole = made
    experiment = spec.of_shard(whole)
    (tmp_path / "data").mkdir()
    written = write(spec, whole, tmp_path)
    floats = rollout(experiment, whole.first, whole.stop)
    assert pq.read_table(tmp_path / written.entry.path).equals(arrow.arrow_table(experiment, whole, floats))
    data = (tmp_path / written.entry.path).read_bytes()
    assert (written.entry.sha256, written.entry.bytes) == (hashlib.sha256(data).hexdigest(), len(data))


def test_the_content_is_that_of_the_table_in_one_piece(made, tmp_path, monkeypatch):
    monkeypatch.setattr(statistics, "sample_stride", lambda rows, total: 7)
    spec, whole = made
    experiment = spec.of_shard(whole)
    (tmp_path / "data").mkdir()
    simulated = write(spec, whole, tmp_path).content
    floats = rollout(experiment, whole.first, whole.stop)
    described = describe(spec, whole, summary.simulated(spec, whole))
    for found in (simulated, described):
        assert found.digests == simulated.digests
        assert found.clipped == floats.clipped
        np.testing.assert_array_equal(found.sample, floats.table[:, ::7])
        rewards = floats.table[floats.names.index("reward")].reshape(-1, STEPS)
        np.testing.assert_allclose(found.returns, rewards.sum(axis=1, dtype=np.float64))
        assert_moments(found.moments, floats.table)
    assert simulated.moments.mean.tobytes() == described.moments.mean.tobytes()


def assert_moments(found, table):
    expected = moments(np.ascontiguousarray(table))
    assert found.rows == expected.rows
    for own, other in zip(found[1:], expected[1:], strict=True):
        np.testing.assert_allclose(own, other, rtol=1e-9, atol=1e-6)


def test_a_shard_that_ends_with_an_error_leaves_nothing(made, tmp_path):
    spec, whole = made
    (tmp_path / "data").mkdir()

    def fail():
        with opened(spec, whole, tmp_path) as writer:
            writer.add(*next(summary.simulated(spec, whole)))
            raise KeyError

    before = threading.active_count()
    with pytest.raises(KeyError):
        fail()
    assert [path.name for path in tmp_path.rglob("*")] == ["data"]
    assert threading.active_count() == before


@pytest.mark.parametrize("thread", ["_encode", "add"])
def test_an_error_in_a_thread_is_raised_and_leaves_nothing(made, tmp_path, monkeypatch, thread):
    def fail(*args):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(
        shard_writer.ShardWriter if thread == "_encode" else summary.ShardSummarizer, thread, fail
    )
    spec, whole = made
    (tmp_path / "data").mkdir()
    with pytest.raises(OSError, match="No space left"):
        write(spec, whole, tmp_path)
    assert [path.name for path in tmp_path.rglob("*")] == ["data"]


def test_parts_are_encoded_in_order_and_no_more_than_two_wait(made, tmp_path, monkeypatch):
    done, gate = [], threading.Event()

    def encode(self, part, floats):
        gate.wait()
        done.append(part.first)

    monkeypatch.setattr(shard_writer.ShardWriter, "_encode", encode)
    spec, whole = made
    with opened(spec, whole, tmp_path) as writer:
        found = list(summary.simulated(spec, whole))
        for part, floats in found[: shard_writer.WAITING]:
            writer.add(part, floats)
        late = threading.Thread(target=writer.add, args=found[shard_writer.WAITING])
        late.start()
        time.sleep(0.05)
        assert late.is_alive()
        gate.set()
        late.join()
        writer.finish()
    assert done == [0, 8, 16]


def test_a_row_group_has_the_rows_of_one_part(made, tmp_path):
    spec, whole = made
    (tmp_path / "data").mkdir()
    written = write(spec, whole, tmp_path)
    found = pq.ParquetFile(tmp_path / written.entry.path).metadata
    sizes = [found.row_group(i).num_rows for i in range(found.num_row_groups)]
    assert sizes == [100, 60, 100, 60, 100, 60, 100, 20]
    assert arrow.ROW_GROUP_ROWS == 100_000
