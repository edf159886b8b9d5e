"""A shard is made, read and described in the parts in which it is simulated, however large its file is."""

import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers import tries
from hypothesis import given
from hypothesis import strategies as st

import ibdata
from ibdata.dataset import statistics
from ibdata.dataset.statistics import Moments, merged, moments, statistics_of_columns
from ibdata.generation import pieces as columns
from ibdata.plan.rollout import FilledColumns, rollout


@pytest.fixture
def experiment(describe):
    """30 episodes of 20 steps in one shard."""
    return describe(steps=20, episodes=15, policies=[{"kind": "safe"}])


def test_parts_do_not_change_a_dataset(experiment, small_blocks, monkeypatch, tmp_path):
    """Only the row groups of its file; quantiles of a sample are of the same rows."""
    small_blocks(sampled_rows=90)
    monkeypatch.setattr(statistics, "SAMPLE_LEAST", 1)
    whole = ibdata.generate(experiment, tmp_path / "whole", workers=1)
    small_blocks(lanes=8, part_rows=200, row_group_rows=100)  # parts have 160 rows
    made = ibdata.generate(experiment, tmp_path / "parts", workers=1)
    assert made.content_root == whole.content_root
    assert made.table().equals(whole.table())
    for name, expected in whole.statistics().items():
        found = made.statistics()[name]
        assert found.pop("quantiles") == expected.pop("quantiles")
        assert found == pytest.approx(expected, rel=1e-9, abs=1e-9)
    np.testing.assert_allclose(made.episodes["return"], whole.episodes["return"], rtol=1e-12)
    (path,) = (made.path / "data").iterdir()
    groups = pq.ParquetFile(path).metadata
    sizes = [groups.row_group(i).num_rows for i in range(groups.num_row_groups)]
    assert sizes == [100, 60, 100, 60, 100, 60, 100, 20]
    assert columns.ROW_GROUP_ROWS == 100_000


PART = 400  # rows
RANDOM = {"random": {"policy": "random"}}
USES = {
    "validate": ibdata.validate,
    "materialize": lambda folder: ibdata.split(
        folder, {"random": {"policy": "random"}}, materialize=folder.parent / "copy"
    ),
    "repair": lambda folder: ((folder / "meta/statistics.json").unlink(), ibdata.repair(folder, workers=1)),
    "reproduce": ibdata.reproduce,
}


def test_few_rows_are_held_at_a_time(describe, tmp_path, monkeypatch, small_blocks):
    small_blocks(lanes=10, part_rows=PART, checked_rows=PART)
    made = ibdata.generate(describe(episodes=50), tmp_path / "made", workers=1)
    assert len(made.manifest["shards"]) == 1
    held = []

    def seen(real):
        def noted(*args):
            found = real(*args)
            held.append(found.table.shape[1])
            return found

        return noted

    monkeypatch.setattr(columns, "FilledColumns", seen(FilledColumns))
    monkeypatch.setattr("ibdata.generation.pieces.rollout", seen(rollout))
    for name, use in USES.items():
        held.clear()
        use(made.path)
        assert sum(held) == len(made) * (2 if name == "repair" else 1), name  # which validates too
        assert max(held) <= PART, name


seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(1, 400)
dtypes = st.sampled_from([np.float32, np.float64])
exact = tries(60)


def drawn(seed, rows, dtype=np.float64):
    """Columns of unlike sizes, one far from 0 and one constant."""
    rng = np.random.default_rng(seed)
    scale, offset = 10.0 ** rng.uniform(-3, 3, 4), 10.0 ** rng.uniform(-2, 4, 4)
    table = rng.normal(size=(4, rows)) * scale[:, None] + offset[:, None]
    table[3] = offset[3]
    return table.astype(dtype)


def merged_moments(table, cuts):
    """The moments of a table in parts of so many rows."""
    first, *others = (moments(np.ascontiguousarray(x)) for x in np.split(table, np.cumsum(cuts)[:-1], axis=1))
    for part in others:
        first = merged(first, part)
    return first


@exact
@given(seed=seeds, cuts=st.lists(sizes, min_size=1, max_size=6), dtype=dtypes)
def test_moments_of_any_parts_are_those_of_numpy(seed, cuts, dtype):
    table = drawn(seed, sum(cuts), dtype)
    found, exact = merged_moments(table, cuts), table.astype(np.float64)
    assert found.rows == table.shape[1]
    assert (found.low == exact.min(axis=1)).all()
    assert (found.high == exact.max(axis=1)).all()
    largest = np.abs(exact).max(axis=1)
    mean = exact.mean(axis=1)  # which may be small where values cancel
    np.testing.assert_array_less(np.abs(found.mean - mean), 1e-13 * np.abs(mean) + 1e-15 * largest)
    squares = ((exact - exact.mean(axis=1, keepdims=True)) ** 2).sum(axis=1)
    magnitude = table.shape[1] * largest**2
    np.testing.assert_array_less(np.abs(found.squares - squares), 1e-10 * squares + 1e-26 * magnitude)


@pytest.mark.parametrize(("at", "odd"), [(0, np.nan), (5, np.inf), (9, np.nan)])
def test_statistics_are_those_of_the_values_that_are_numbers(at, odd):
    table = np.stack([np.arange(10.0), np.full(10, 3.0), np.full(10, odd)])
    table[0, at] = odd
    known = np.delete(table[0], at)
    for cuts in ([10], [5, 5], [1, 9], [9, 1]):
        found = merged_moments(table, cuts)
        assert (found.rows, found.counts.tolist()) == (10, [9, 10, 0])
        parts = [np.ascontiguousarray(x) for x in np.split(table, np.cumsum(cuts)[:-1], axis=1)]
        one, _, none = statistics_of_columns(["a", "b", "c"], found, parts, cuts).values()
        assert (one.count, one.min, one.max) == (9, known.min(), known.max())
        np.testing.assert_allclose([one.mean, one.std], [known.mean(), known.std()], rtol=1e-15)
        median = np.quantile(known, 0.5, method="inverted_cdf")
        assert one.quantiles["0.5"] == median
        assert none.count == 0
        assert {none.mean, none.std, none.min, none.max, *none.quantiles.values()} == {None}


def test_a_sample_stands_for_the_rows_of_its_shard():
    """Three of 300 rows are 1, 2, 3 and one of one is 9: half of all rows are at most 2."""
    samples = [np.array([[1.0, 2.0, 3.0]]), np.array([[9.0]])]
    parts = Moments(301, np.array([2.0]), np.array([1.0]), np.array([1.0]), np.array([9.0]), np.array([301]))
    quantiles = statistics_of_columns(("x",), parts, samples, [300, 1])["x"].quantiles
    assert (quantiles["0.25"], quantiles["0.5"], quantiles["0.99"]) == (1.0, 2.0, 3.0)
