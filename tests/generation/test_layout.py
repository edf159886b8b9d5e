"""The files after a run: the tree, the manifest, the metadata, the card, the Parquet files."""

from __future__ import annotations

import hashlib
import json
import re

import numpy as np
import pyarrow.parquet as pq
import pytest
from ruamel.yaml import YAML

import ibdata

SHARDS = [(0, 2), (2, 3), (3, 5), (5, 6), (6, 8), (8, 9), (9, 11), (11, 12)]  # of `dataset`, by episode
META = ["croissant.json", "dataset.json", "episodes.table", "experiment.yaml", "manifest.json"]
META += ["splits.json", "statistics.json"]


def files(folder):
    return {str(path.relative_to(folder)): path for path in folder.rglob("*") if not path.is_dir()}


def test_the_folder_holds_the_card_the_metadata_and_the_shards(dataset):
    shards = [shard["path"] for shard in dataset.manifest["shards"]]
    assert len(shards) == len(SHARDS)
    for i, path in enumerate(shards):
        assert re.fullmatch(rf"data/part-{i:05d}-[0-9a-f]{{16}}\.parquet", path)
    assert set(files(dataset.path)) == {"README.md", *shards, *(f"meta/{name}" for name in META)}


def test_the_manifest_lists_all_files_with_size_and_hash(either):
    listed = {file["path"]: file for file in either.manifest["files"]}
    found = files(either.path)
    assert set(listed) == set(found) - {"README.md", "meta/manifest.json", "meta/splits.json"}
    for name, file in listed.items():
        data = found[name].read_bytes()
        assert (file["bytes"], file["sha256"]) == (len(data), hashlib.sha256(data).hexdigest()), name


def test_the_manifest_counts_the_rows_with_a_clipped_action(large):
    actions = np.stack([large.table()[f"act_{name}"] for name in ("velocity", "gain", "shift")])
    assert large.manifest["clipped_actions"] == (np.abs(actions) == 1.0).any(axis=0).sum() > 0


def test_shards_are_whole_episodes_cut_where_splits_begin(dataset, plain_digests):
    shards = dataset.manifest["shards"]
    assert [tuple(shard["episodes"]) for shard in shards] == SHARDS
    assert sum(shard["rows"] for shard in shards) == dataset.manifest["rows"] == 480
    splits = [["source"], ["source"], ["target"], [], ["source"], ["source"], ["target"], []]
    assert [shard["splits"] for shard in shards] == splits
    for shard in shards:
        table = pq.read_table(dataset.path / shard["path"])
        digests = plain_digests(table)
        assert list(digests) == list(range(*shard["episodes"]))
        assert table.num_rows == shard["rows"]
        assert hashlib.sha256(b"".join(digests.values())).hexdigest() == shard["content"]


def test_info_describes_counts_and_columns(dataset):
    info = json.loads((dataset.path / "meta/dataset.json").read_text())
    assert list(info) == [
        "format", "version", "name", "dynamics", "drifting", "start", "counts", "columns",
    ]  # fmt: skip
    assert (info["format"], info["version"], info["name"]) == ("ibdata-dataset", 1, "small")
    assert info["counts"] == {"rows": 480, "episodes": 12, "steps": 40, "cells": 4, "shards": 8}
    assert [column["name"] for column in info["columns"]] == dataset.table().column_names
    assert list(info["columns"][0]) == ["name", "role", "dtype", "unit", "low", "high", "description"]


def test_episodes_parquet_is_what_the_rows_say(either, plain_digests):
    rows = either.episodes
    assert list(rows.columns) == [
        "episode", "setpoint", "policy", "acting", "splits", "length", "return", "cell", "index", "shard",
        "row_start", "row_stop", "digest",
    ]  # fmt: skip
    experiment = ibdata.load(either.path / "meta/experiment.yaml")
    table = either.table()
    digests = plain_digests(table)
    assert rows["episode"].tolist() == list(digests) == list(range(12))
    for row in rows.itertuples():
        shard = either.manifest["shards"][row.shard]
        part = pq.read_table(either.path / shard["path"]).slice(row.row_start, row.row_stop - row.row_start)
        cell = experiment.cells[row.episode // 3]
        assert set(part["episode"].to_pylist()) == {row.episode}
        assert part["step"].to_pylist() == list(range(row.length)) == list(range(40))
        assert row.digest == digests[row.episode]
        assert set(part["policy"].to_pylist()) == {row.policy} == {cell.label}
        assert (row.index, row.cell) == (row.episode % 3, cell.digest.hex())
        assert row.setpoint == cell.setpoint
        assert list(row.splits) == shard["splits"]
        returned = rows["return"][row.Index]
        assert returned == pytest.approx(sum(part["reward"].to_pylist()), rel=1e-12)
    if not experiment.drifting:
        assert rows["setpoint"][table["episode"].to_numpy()].tolist() == table["obs_setpoint"].to_pylist()


@pytest.mark.parametrize("name", ["dataset", "moving", "large"])
def test_stats_are_those_of_the_rows(request, name):
    dataset = request.getfixturevalue(name)
    stats = json.loads((dataset.path / "meta/statistics.json").read_text())
    assert list(stats["splits"]) == list(dataset.splits)
    for split, described in {None: stats["all"], **stats["splits"]}.items():
        assert described == dataset.statistics(split)
        table = dataset.table(split=split)
        floats = [c["name"] for c in dataset.info["columns"] if c["dtype"].startswith("float")]
        assert list(described) == floats
        for column in floats:
            x, found = table[column].to_numpy().astype(np.float64), described[column]
            scale = 1e-12 * np.abs(x).max()
            assert found["count"] == len(x)
            assert (found["min"], found["max"]) == (x.min(), x.max())
            assert found["mean"] == pytest.approx(x.mean(), rel=1e-12, abs=scale)
            assert found["std"] == pytest.approx(x.std(), rel=1e-12, abs=scale if x.std() == 0.0 else 0.0)
            probabilities = [float(q) for q in found["quantiles"]]
            assert probabilities == [0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99]
            exact = np.quantile(x, probabilities, method="inverted_cdf")
            if len(x) <= 50_000:
                assert list(found["quantiles"].values()) == exact.tolist()
            else:
                ranks = [(x <= q).mean() for q in found["quantiles"].values()]
                assert np.all(np.array(ranks) > np.array(probabilities) - 0.01)
                strictly = [(x < q).mean() for q in found["quantiles"].values()]
                assert np.all(np.array(strictly) < np.array(probabilities) + 0.01)


def test_the_front_matter_names_the_files_of_every_split(dataset):
    opening, front, text = (dataset.path / "README.md").read_text().split("---\n", 2)
    matter = YAML(typ="safe", pure=True).load(front)
    assert opening == ""
    assert matter["size_categories"] == ["n<1K"]
    assert matter["task_categories"] == ["reinforcement-learning"]
    default, *configs = matter["configs"]
    assert len({each.pop("description") for each in matter["configs"]}) == 1  # of all files
    whole = [{"split": "everything", "path": ["data/part-*.parquet"]}]
    assert default == {"config_name": "default", "default": True, "data_files": whole}
    splits = {config["config_name"]: config["data_files"] for config in configs}
    for name in ("source", "target"):
        assert splits[name] == [{"split": name, "path": paths_of(dataset, name)}]
    assert dataset.content_root in text
    assert "| source | 6 | 240 |" in text


def paths_of(dataset, split):
    return [shard["path"] for shard in dataset.manifest["shards"] if split in shard["splits"]]


def test_splits_that_share_and_lack_nothing_are_those_of_the_hub(describe, made_at, tmp_path):
    """Without splits, the hub has its own one, train, which never has the rows of a test split in it."""
    for splits in ({}, {"train": {"setpoint": 20}, "fold-1": {"setpoint": 70, "policy": "random"}}):
        if splits:
            splits["all"] = {"setpoint": 70, "policy": "calm"}
        made = made_at(describe(splits=splits), tmp_path / f"{len(splits)}")
        front = (made.path / "README.md").read_text().split("---\n")[1]
        [config] = YAML(typ="safe", pure=True).load(front)["configs"]
        assert re.fullmatch("files [0-9a-f]{16}", config.pop("description"))
        names = {"train": "train", "fold-1": "fold_1", "all": "all_"}
        expected = [{"split": names[name], "path": paths_of(made, name)} for name in splits]
        whole = [{"split": "train", "path": ["data/part-*.parquet"]}]
        assert config == {"config_name": "default", "default": True, "data_files": expected or whole}


UP, DOWN = ({"kind": "constant", "action": [x] * 3} for x in (0.5, -0.5))
MIXTURE = {"kind": "mixture", "bases": [UP, "safe", DOWN], "weights": [2, 1, 1], "name": "mixed"}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    plain = {"name": "mixed", "setpoints": [20, 70], "steps": 3, "episodes": 20, "seed": 3}
    plain["output"] = {"shard_rows": 30}
    return ibdata.generate({**plain, "policies": ["random", MIXTURE]}, tmp_path_factory.mktemp("a") / "mixed")


def test_the_policy_that_acts_is_the_one_whose_actions_are_recorded(made):
    rows = made.to_pandas(columns=["episode", "act_velocity"])
    actions = rows.groupby("episode")["act_velocity"].agg(list)
    found = made.episodes["acting"].astype(str)
    assert set(found) == {"random", "constant", "safe", "constant-2"}
    assert (found[made.episodes["policy"] == "random"] == "random").all()
    for label, action in (("constant", 0.5), ("constant-2", -0.5)):
        for episode in made.episodes["episode"][found == label]:
            assert actions[episode] == [action] * 3
    assert (found == "constant").sum() > (found == "constant-2").sum() > 0


def test_it_stays_with_the_episode(made, tmp_path):
    other = ibdata.generate({"name": "x", "setpoints": 70, "steps": 3, "policies": ["safe"]}, tmp_path / "x")
    merged = ibdata.merge([other.path, made.path], out=tmp_path / "merged")
    assert merged.episodes["acting"].astype(str).tolist() == ["safe", *made.episodes["acting"]]
    (merged.path / "meta" / "episodes.table").unlink()
    ibdata.repair(merged.path)
    assert ibdata.validate(merged.path) == []
