"""Digests and content roots depend on the values, not on the files, and differ if any bit differs."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import ibdata
from ibdata.dataset.digest import content_root, episode_digests, text
from ibdata.experiment.columns import columns
from ibdata.experiment.plan import Shard
from ibdata.experiment.rollout import rollout
from ibdata.writing.arrow import digest_runs

# ibdata generate --config random.yaml --set steps=3 --set episodes=2 --seed 5 --out golden
# made by ibdata 0.1.0 at commit a995b53 on x86-64; the same on every machine, for ever
GOLDEN = "eca6844419622e0ead4ff2102eaba311afe943ea615e842a8989bb2e868c1c35"


def test_a_golden_dataset_keeps_its_content_root(tmp_path):
    made = ibdata.generate(
        "random.yaml", tmp_path / "golden", overrides=["steps=3", "episodes=2"], seed=5, workers=1
    )
    assert made.content_root == GOLDEN


def test_digests_are_those_of_a_plain_implementation(either, plain_digests):
    stored = dict(zip(either.episodes["episode"], either.episodes["digest"], strict=True))
    assert plain_digests(either.table()) == stored


def test_the_content_root_is_that_of_a_plain_implementation(either, plain_root):
    assert plain_root(either, either.table()) == either.content_root


def test_no_two_episodes_have_one_digest(large):
    assert large.episodes["digest"].nunique() == 120


@pytest.mark.parametrize("shard_rows", [1, 130, 1_000_000])
def test_shards_do_not_change_the_root(describe, dataset, tmp_path, shard_rows):
    experiment = describe(output={"latent": "next", "shard_rows": shard_rows})
    made = ibdata.generate(experiment, tmp_path / "other", workers=1)
    assert made.content_root == dataset.content_root
    assert made.manifest["shards"][0]["rows"] == {1: 40, 130: 120, 1_000_000: 480}[shard_rows]


@pytest.mark.slow
def test_workers_do_not_change_the_root(declared, dataset, tmp_path):
    assert ibdata.generate(declared, tmp_path / "two", workers=2).content_root == dataset.content_root


def test_names_and_the_order_of_cells_do_not_change_the_root(describe, dataset, tmp_path):
    turned = describe(name="turned", setpoints=[70.0, 20.0], output={"latent": "next"})
    made = ibdata.generate(turned, tmp_path / "turned", workers=1)
    assert made.content_root == dataset.content_root


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 1},
        {"dynamics": "paper"},
        {"steps": 41},
        {"episodes": 4},
        {"setpoints": [20.0, 70.5]},
        {"policies": [{"kind": "random"}, {"kind": "safe", "name": "quiet"}]},
        {"start": "uniform"},
        {"output": {"latent": "full"}},
        {"output": {"latent": "next", "dtype": "float64"}},
    ],
    ids=str,
)
def test_other_content_has_another_root(describe, dataset, tmp_path, change):
    made = ibdata.generate(describe(**{"output": {"latent": "next"}, **change}), tmp_path / "x", workers=1)
    assert made.content_root != dataset.content_root


@pytest.mark.parametrize("layout", ["row groups", "codec", "shuffled episodes", "files"])
def test_the_root_survives_other_layouts_of_the_same_rows(dataset, plain_root, tmp_path, layout):
    table = dataset.table()
    if layout == "row groups":
        pq.write_table(table, tmp_path / "0.parquet", row_group_size=77)
    elif layout == "codec":
        pq.write_table(table, tmp_path / "0.parquet", compression="snappy", data_page_version="2.0")
    elif layout == "shuffled episodes":
        order = np.random.default_rng(3).permutation(12)
        rows = (order[:, None] * 40 + np.arange(40)).reshape(-1)
        pq.write_table(table.take(pa.array(rows)), tmp_path / "0.parquet", use_dictionary=False)
    else:
        for i in range(12):
            pq.write_table(table.slice(i * 40, 40), tmp_path / f"{i:02d}.parquet", compression="gzip")
    assert plain_root(dataset, pq.read_table(tmp_path)) == dataset.content_root


@pytest.fixture(scope="module")
def shard(declared):
    """The columns of two episodes as they enter a digest, and their digests."""
    part = Shard(0, 4, 6, ())
    runs = digest_runs(declared, part, rollout(declared, part.first, part.stop))
    return runs, episode_digests(runs, [40, 40])


def test_the_runs_of_a_digest_are_all_columns_but_the_episode(declared, shard):
    runs, _ = shard
    widths = [1 if isinstance(run, list) else len(run) for run in runs]
    assert widths == [1, 10, 1, 1, 6 + 14 + 14, 1, 1]
    assert sum(widths) == len(columns(declared)) - 1


@pytest.mark.parametrize("number", [0, 1, 2, 3, 4, 6])
def test_a_flipped_bit_changes_the_digest_of_its_episode_only(shard, number):
    runs, digests = shard
    rng = np.random.default_rng(number)
    for row_of_run in range(len(runs[number])):
        for bit in range(8 * runs[number].itemsize):
            changed = runs[number].copy()
            position = int(rng.integers(80))
            place = changed[row_of_run, position : position + 1].view(np.uint8)
            place[bit // 8] ^= 1 << bit % 8
            found = episode_digests([*runs[:number], changed, *runs[number + 1 :]], [40, 40])
            assert [a == b for a, b in zip(found, digests, strict=True)] == [position >= 40, position < 40]


def test_another_label_or_length_changes_the_digest(shard):
    runs, digests = shard
    assert runs[5] == [text("random")] * 2
    renamed = episode_digests([*runs[:5], [text("random"), text("randon")], *runs[6:]], [40, 40])
    assert [a == b for a, b in zip(renamed, digests, strict=True)] == [True, False]
    assert not {*episode_digests(runs, [39, 41])} & {*digests}


def test_the_byte_order_does_not_change_the_digest(shard):
    runs, digests = shard
    other = [run if isinstance(run, list) else run.astype(run.dtype.newbyteorder(">")) for run in runs]
    assert episode_digests(other, [40, 40]) == digests


def test_the_root_depends_on_each_part_and_on_no_order(declared):
    described = [(column.name, column.dtype) for column in columns(declared)]
    members = [(bytes([cell]) * 32, index, bytes([cell + index]) * 32) for cell in (1, 2) for index in (0, 1)]
    root = content_root(described, members)
    assert content_root(described, reversed(members)) == root
    cell, index, digest = members[0]
    for other in ((b"\0" * 32, index, digest), (cell, 7, digest), (cell, index, b"\0" * 32)):
        assert content_root(described, [other, *members[1:]]) != root
    assert content_root(described, members[1:]) != root
    assert content_root(described[:-1], members) != root
    assert content_root([("number", "int64"), *described[1:]], members) != root
    assert content_root([*described[:-1], ("action_log_prob", "float64")], members) != root
