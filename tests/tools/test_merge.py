"""Merging: all episodes are there, none twice, and the result is a valid dataset."""

import shutil

import pytest
from helpers.folders import part_of, run_of, seal
from helpers.splits import BY_POLICY

import ibdata
from ibdata.errors import DatasetError, Interrupted, UsageError
from ibdata.tools import rewrite
from ibdata.tools.listing import datasets_in

PLAIN = {
    "name": "a",
    "setpoints": [20.0, 70.0],
    "policies": [{"kind": "random"}],
    "episodes": 3,
    "steps": 4,
    "output": {"shard_rows": 8},
    "splits": {"low": {"setpoint": 20}},
}
OTHER = {
    **PLAIN,
    "name": "b",
    "seed": 1,
    "steps": 5,
    "policies": [{"kind": "safe"}, {"kind": "random"}],
    "splits": {"high": {"setpoint": 70}},
}


@pytest.fixture
def make(made_at, tmp_path):
    return lambda name, **changes: made_at({**PLAIN, "name": name, **changes}, tmp_path / name)


@pytest.fixture(scope="module")
def pair(made_at, tmp_path_factory):
    """Two datasets that differ in seed, policy, length of episodes, shards and splits."""
    folder = tmp_path_factory.mktemp("pair")
    return [made_at(plain, folder / plain["name"]) for plain in (PLAIN, OTHER)]


@pytest.fixture(scope="module")
def merged(pair, tmp_path_factory):
    """Of `pair`."""
    return ibdata.merge([each.path for each in pair], tmp_path_factory.mktemp("merged") / "both")


def test_a_merged_dataset_holds_the_episodes_of_all(pair, merged):
    digests, expected = list(merged.episodes["digest"]), [x for d in pair for x in d.episodes["digest"]]
    assert digests == expected
    assert merged.episodes["episode"].tolist() == list(range(6 + 12))
    assert merged.episodes["length"].tolist() == [4] * 6 + [5] * 12
    frame = merged.to_pandas()
    assert frame["episode"].drop_duplicates().tolist() == list(range(18))
    rewards = [x for d in pair for x in d.to_pandas()["reward"]]
    assert frame["reward"].tolist() == rewards
    counts = {"rows": 84, "episodes": 18, "steps": None, "cells": 4, "shards": 4 + 12}
    assert merged.info["counts"] == counts
    assert {name: split["episodes"] for name, split in merged.splits.items()} == {"low": 3, "high": 6}
    assert ibdata.validate(merged.path) == []
    assert merged.statistics()["reward"]["mean"] == pytest.approx(sum(rewards) / 84, rel=1e-6)


def test_episodes_of_a_third_dataset_follow_those_of_two(make, tmp_path):
    parts = [make(name, seed=seed) for seed, name in enumerate("abc")]
    two = ibdata.merge([each.path for each in parts[:2]], tmp_path / "two")
    merged = ibdata.merge([two.path, parts[2].path], tmp_path / "all")
    assert merged.to_pandas()["reward"].tolist() == [x for d in parts for x in d.to_pandas()["reward"]]
    assert merged.to_pandas()["episode"].drop_duplicates().tolist() == list(range(18))
    split = ibdata.split(merged.path, {"source": {"setpoint": 20}, "target": {"setpoint": 70}})
    assert sorted(set(split.to_pandas(split="target")["episode"])) == [3, 4, 5, 9, 10, 11, 15, 16, 17]
    assert ibdata.validate(split) == []


def test_a_merged_dataset_is_reproduced_whole_and_in_part(merged):
    assert ibdata.reproduce(merged.path) == (18, [])
    assert ibdata.reproduce(merged.path, 6) == (6, [])


WAYS = {
    "merge": lambda pair, out: ibdata.merge([each.path for each in pair], out),
    "materialize": lambda pair, out: ibdata.split(pair[1].path, BY_POLICY, materialize=out),
}


@pytest.mark.parametrize("write", WAYS.values(), ids=WAYS)
def test_what_was_stopped_goes_on_without_copying_again(pair, monkeypatch, tmp_path, write):
    copied, real, most = [], rewrite.write_shard, None

    def noting(spec, shard, *rest):
        if len(copied) == most:
            raise Interrupted(15)
        copied.append(shard.number)
        return real(spec, shard, *rest)

    monkeypatch.setattr(rewrite, "write_shard", noting)
    plain = write(pair, tmp_path / "plain/out")
    whole, most = len(copied), 3
    copied.clear()
    with pytest.raises(Interrupted, match="3 shards are finished; the same command goes on"):
        write(pair, tmp_path / "out")
    states = [each.state for each in datasets_in(tmp_path)]
    assert states == [f"unfinished, 3 of {whole} shards", "finished"]
    most = None
    (run_of(tmp_path / "out") / "receipts/00001.npy").write_bytes(b"damaged")
    made = write(pair, tmp_path / "out")
    assert copied == [0, 1, 2, 1, *range(3, whole)]
    assert made.content_root == plain.content_root
    assert not part_of(made.path).exists()


def test_splits_of_one_name_become_one_and_labels_get_files(make, tmp_path):
    a, b = make("a"), make("b", seed=1)
    ibdata.split(a.path, {"train": {"episodes": 2}, "test": {"episodes": {"start": 2, "stop": 2}}})
    splits = ibdata.merge([a.path, b.path], tmp_path / "both").splits
    assert {name: split["episodes"] for name, split in splits.items()} == {"low": 6, "train": 4, "test": 2}
    assert all(split["declared"] for split in splits.values())
    assert ibdata.validate(tmp_path / "both") == []


SAME = "setpoint 20, policy random: the same episodes are also in"


SHARED = [
    ({}, SAME),
    ({"episodes": 1, "policies": [{"kind": "random", "name": "other"}]}, "policy other: the same episodes"),
    ({"seed": 1, "output": {"latent": False}}, "column latent_theta_1: found None, expected .float32."),
    ({"seed": 1, "output": {"dtype": "float64"}}, "column obs_setpoint: found .float64., expected .float32."),
]


def test_shared_episodes_and_other_columns_are_refused(make, tmp_path):
    one = make("a").path
    for i, (change, line) in enumerate(SHARED):
        with pytest.raises(UsageError, match=line):
            ibdata.merge([one, make(f"b{i}", **change).path], tmp_path / "both")
    assert not (tmp_path / "both").exists()


def test_equal_episodes_are_found_where_the_experiments_differ(make, tmp_path):
    """Two experiments never make equal episodes; but a manifest may name another seed for its rows."""
    a = make("a")
    shutil.copytree(a.path, tmp_path / "again")
    seal(tmp_path / "again", lambda listed: listed["experiments"][0].update(seed=1))
    with pytest.raises(
        UsageError,
        match=r"again: setpoint 20, policy random: the same episodes are also in .*; leave one out, or",
    ):
        ibdata.merge([a.path, tmp_path / "again"], tmp_path / "both")
    assert not (tmp_path / "both").exists()


FORGED = {
    "no seed": lambda listed: listed["experiments"][0].pop("seed"),
    "a list as seed": lambda listed: listed["experiments"][0].update(seed=[1]),
    "no experiment": lambda listed: listed["shards"][0].update(experiment=7),
}


@pytest.mark.parametrize("forge", FORGED.values(), ids=FORGED)
def test_a_forged_manifest_is_one_line(pair, tmp_path, forge):
    """It fits its checksum, and nothing else."""
    shutil.copytree(pair[0].path, tmp_path / "forged")
    seal(tmp_path / "forged", forge)
    for call in (ibdata.open, lambda folders: ibdata.merge(folders, tmp_path / "no")):
        with pytest.raises(DatasetError, match=r"do not fit each other; see ibdata validate$"):
            call([pair[1], tmp_path / "forged"])
