"""meta/croissant.json follows from the experiments and the manifest; tests/bridges/readers reads it."""

import json
from pathlib import Path

from helpers.datasets import PLAIN
from helpers.folders import seal

import ibdata
from ibdata.dataset import manifest


def described(dataset):
    return json.loads(Path(dataset.path, manifest.CROISSANT).read_bytes())


def by_id(items):
    return {item["@id"]: item for item in items}


def test_a_field_has_the_unit_the_meaning_and_the_bounds_of_its_column(either):
    (rows, *_) = described(either)["recordSet"]
    types = {"int": "Int", "float": "Float", "bool": "Boolean", "string": "Text"}
    assert [field["name"] for field in rows["field"]] == either.table().column_names
    for field, column in zip(rows["field"], either.info["columns"], strict=True):
        kind = column["dtype"].rstrip("3264")
        assert field["dataType"].partition(":")[2] == types[kind] + column["dtype"].removeprefix(kind)
        bounds = (field.get("minValue"), field.get("maxValue"))
        assert (field["description"], field["unitText"], *bounds) == (
            column["description"], column["unit"], column["low"], column["high"],
        )  # fmt: skip


def test_the_files_and_the_splits_are_those_of_the_manifest(dataset):
    told = described(dataset)
    files = by_id(told["distribution"])
    for path, entry in dataset.stored.manifest.entries().items():
        if path != manifest.CROISSANT:
            assert (files[path]["sha256"], files[path]["contentSize"]) == (entry.sha256, f"{entry.bytes} B")
            assert (dataset.path / "meta" / files[path]["contentUrl"]).resolve() == dataset.path / path
    shards = dataset.manifest["shards"]
    sets = by_id(told["recordSet"])
    assert list(sets) == ["rows", "split/source", "split/target", "splits"]
    for name in ("source", "target"):
        paths = [shard["path"] for shard in shards if name in shard["splits"]]
        assert files[f"files/{name}"]["includes"] == paths
        (used,) = {field["source"]["fileSet"]["@id"] for field in sets[f"split/{name}"]["field"]}
        assert used == f"files/{name}"
    counts = {
        row["splits/name"]: (row["splits/episodes"], row["splits/rows"]) for row in sets["splits"]["data"]
    }
    assert counts == {name: (split["episodes"], split["rows"]) for name, split in dataset.splits.items()}


def test_a_dataset_of_an_earlier_version_without_it_is_whole_and_used(made_at, tmp_path):
    earlier = made_at(PLAIN, tmp_path / "earlier")
    seal(earlier.path, lambda listed: listed["files"].pop())
    (earlier.path / manifest.CROISSANT).unlink()
    assert ibdata.validate(earlier.path) == []
    assert ibdata.repair(earlier.path, workers=1) == []
    assert set(ibdata.split(earlier.path, by="policy").splits) == {"source", "random", "safe"}
    assert not (earlier.path / manifest.CROISSANT).exists()
    copy = ibdata.split(earlier.path, materialize=tmp_path / "copy")
    assert described(copy)["distribution"][0]["sha256"] == earlier.content_root


def test_a_description_of_another_form_is_named(copied):
    for text in ("[]", "{", '{"distribution": 1}', "[[1]]"):
        (copied / manifest.CROISSANT).write_text(text)
        seal(copied)
        assert [(p.path, p.rule) for p in ibdata.validate(copied)] == [(manifest.CROISSANT, "metadata")]
