"""Every rule finds the row that breaks it, in a file whose hash is correct."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from helpers.datasets import AS_WRITTEN
from helpers.forging import seal

from ibdata.dataset import manifest
from ibdata.errors import BusyError
from ibdata.maintenance.repair import repair
from ibdata.validation.rows import check_shard
from ibdata.validation.validate import validate
from ibdata.writing.metadata import as_json


@pytest.fixture
def shard(copied, shard_file) -> str:
    """The path of the shard that is damaged."""
    return shard_file(copied, 1)


@pytest.fixture
def change(copied, shard, sign) -> Callable[[str, int, object], None]:
    """Put a value into a column of the shard, and sign the file."""

    def put(name: str, row: int, value: object) -> None:
        table = pq.read_table(copied / shard)
        values = table[name].to_pylist()
        values[row] = value
        index = table.column_names.index(name)
        column = pa.array(values, table.schema.field(name).type)
        changed = table.set_column(index, table.schema.field(name), column)
        pq.write_table(changed, copied / shard, **AS_WRITTEN)
        sign(copied, shard)

    return put


def rules(folder: Path) -> set[tuple[str, int | None, str]]:
    return {(p.path, p.row, p.rule) for p in validate(folder)}


def test_a_dataset_that_was_just_made_is_valid(either):
    assert validate(either.path) == []
    assert validate(either.path, quick=True) == []


@pytest.mark.parametrize(
    ("name", "row", "value", "rule"),
    [
        ("obs_velocity", 3, float("nan"), "finite"),
        ("reward", 3, float("inf"), "finite"),
        ("obs_gain", 5, 100.5, "bounds"),
        ("latent_direction", 5, -7.0, "bounds"),
        ("episode", 7, 99, "indices"),
        ("step", 7, 8, "indices"),
        ("terminated", 7, True, "flags"),
        ("truncated", 39, False, "flags"),
        ("truncated", 7, True, "flags"),
        ("next_obs_shift", 11, 50.5, "continuity"),
        ("reward", 13, -1.0, "reward"),
        ("obs_setpoint", 0, 21.0, "setpoint"),
        ("policy", 2, "other", "policy"),
        ("next_obs_velocity", 39, 33.25, "steering"),
        ("act_gain", 4, 0.015625, "steering"),
        ("latent_theta_3", 17, 66.5, "shift register"),
        ("action_log_prob", 21, -1.5, "density"),
    ],
)
def test_a_broken_row_is_named_with_its_rule(copied, shard, change, name, row, value, rule):
    change(name, row, value)
    assert (shard, row, rule) in rules(copied)


def test_rows_that_keep_every_rule_but_are_others_are_named(copied, shard, change):
    """Nothing is said of a hidden value at the first step, but that it is the one that was listed."""
    change("latent_mu_v", 0, 0.25)
    assert rules(copied) >= {(shard, None, "digest"), ("meta/episodes.parquet", 2, "digest")}


def test_a_return_that_is_not_that_of_the_rows_is_named(copied, shard, sign):
    path = copied / "meta/episodes.parquet"
    table = pq.read_table(path)
    returns = table["return"].to_pylist()
    returns[2] += 0.5
    index = table.column_names.index("return")
    pq.write_table(table.set_column(index, table.schema.field("return"), pa.array(returns)), path)
    sign(copied, "meta/episodes.parquet")
    assert rules(copied) == {("meta/episodes.parquet", 2, "return")}


def test_a_missing_value_is_named(copied, shard, sign):
    table = pq.read_table(copied / shard)
    values = [None if i == 4 else x for i, x in enumerate(table["obs_shift"].to_pylist())]
    index = table.column_names.index("obs_shift")
    changed = table.set_column(index, "obs_shift", pa.array(values, pa.float32()))
    pq.write_table(changed, copied / shard, **AS_WRITTEN)
    sign(copied, shard)
    assert rules(copied) == {(shard, 4, "nulls")}


@pytest.mark.parametrize("change_schema", ["drop", "rename", "type", "order"])
def test_another_schema_is_named(copied, shard, sign, change_schema):
    table = pq.read_table(copied / shard)
    names = table.column_names
    changed = {
        "drop": lambda: table.drop_columns(["reward"]),
        "rename": lambda: table.rename_columns(["number", *names[1:]]),
        "type": lambda: table.set_column(2, names[2], table[names[2]].cast(pa.float64())),
        "order": lambda: table.select([names[1], names[0], *names[2:]]),
    }[change_schema]()
    pq.write_table(changed, copied / shard)
    sign(copied, shard)
    assert rules(copied) == {(shard, None, "schema")}


def test_rows_that_are_missing_are_named(copied, shard, sign):
    pq.write_table(pq.read_table(copied / shard).slice(0, 20), copied / shard)
    sign(copied, shard)
    assert rules(copied) == {(shard, None, "rows")}


@pytest.mark.parametrize(
    "what", ["shard", "meta/dataset.json", "meta/statistics.json", "meta/experiment.yaml"]
)
@pytest.mark.parametrize("quick", [True, False])
def test_a_file_that_is_changed_or_missing_is_named(copied, shard, what, quick):
    path = shard if what == "shard" else what
    data = bytearray((copied / path).read_bytes())
    data[len(data) // 2] ^= 1
    (copied / path).write_bytes(data)
    assert [(p.path, p.rule) for p in validate(copied, quick)] == [(path, "hash")]
    (copied / path).unlink()
    assert [(p.path, p.rule) for p in validate(copied, quick)] == [(path, "file")]


@pytest.mark.slow
def test_a_dataset_of_symbolic_links_is_valid(copied, ibdata, tmp_path):
    """As Hugging Face's cache, DVC and git-annex keep what was downloaded."""
    blobs = tmp_path / "blobs"
    blobs.mkdir()
    links = [path for path in copied.rglob("*") if path.is_file()]
    for number, path in enumerate(links):
        path.rename(blobs / str(number))
        path.symlink_to(os.path.relpath(blobs / str(number), path.parent))
    assert validate(copied) == []
    assert validate(copied, quick=True) == []
    assert repair(copied, workers=1) == []
    for command in ("validate", "repair"):
        done = ibdata(command, str(copied))
        assert (done.returncode, done.stderr) == (0, "")
    assert all(path.is_symlink() for path in links)


def test_a_file_among_the_data_that_is_not_listed_is_named(copied):
    (copied / "data/part-00099-1a2b3c4d.parquet").write_bytes(b"stray")
    assert [(p.path, p.rule) for p in validate(copied)] == [("data/part-00099-1a2b3c4d.parquet", "file")]


def test_a_damaged_manifest_is_the_only_problem(copied):
    (copied / manifest.PATH).write_text("{")
    (problem,) = validate(copied)
    assert (problem.path, problem.rule) == (manifest.PATH, "manifest")


@pytest.mark.parametrize("key", ["mean", "std", "min", "max", "count"])
@pytest.mark.parametrize("split", [None, "target"])
def test_statistics_that_are_not_those_of_the_rows_are_named(copied, sign, key, split):
    path = copied / "meta/statistics.json"
    stats = json.loads(path.read_bytes())
    (stats["all"] if split is None else stats["splits"][split])["reward"][key] += 1
    path.write_text(json.dumps(stats))
    sign(copied, "meta/statistics.json")
    (problem,) = validate(copied)
    assert (problem.path, problem.rule) == ("meta/statistics.json", "statistics")
    assert f"reward: {key}: found " in problem.message


def test_another_content_root_is_named(copied):
    listed = json.loads((copied / manifest.PATH).read_bytes())
    listed["content_root"] = "0" * 64
    listed["checksum"] = manifest.checksum(listed)
    (copied / manifest.PATH).write_bytes(as_json(listed))
    assert [(p.path, p.rule) for p in validate(copied)] == [(manifest.PATH, "content root")]


def test_many_broken_rows_are_one_problem_that_counts_them(copied, shard, sign):
    table = pq.read_table(copied / shard)
    index = table.column_names.index("obs_gain")
    wrong = pa.array(np.full(table.num_rows, 101.0), pa.float32())
    pq.write_table(table.set_column(index, table.schema.field("obs_gain"), wrong), copied / shard)
    sign(copied, shard)
    (found,) = (p for p in validate(copied) if p.rule == "bounds" and p.message.startswith("obs_gain"))
    assert str(found) == (
        f"{shard}: row 0: bounds: obs_gain: found 101.0, expected at most 100 ({table.num_rows} such rows)"
    )


@pytest.mark.parametrize("name", [".part-00000-aaaaaaaa.parquet", ".Part.PARQUET", ".h/part.parquet", ".h"])
def test_hidden_parquet_and_folders_in_data_are_named(copied, shard, name):
    path = copied / "data" / name
    if name == ".h":
        path.mkdir()
    else:
        path.parent.mkdir(exist_ok=True)
        shutil.copy(copied / shard, path)
    (copied / "data/.DS_Store").write_text("no reader takes it")
    (problem,) = validate(copied)
    assert (problem.path, problem.rule) == (f"data/{name.partition('/')[0]}", "file")
    assert "that the manifest does not list; move it away" in problem.message


def test_a_dataset_that_is_replaced_meanwhile_is_busy(copied, monkeypatch):
    def replacing(*arguments):
        seal(copied, lambda listed: listed.update(versions={"ibdata": "another"}))
        return check_shard(*arguments)

    monkeypatch.setattr("ibdata.validation.validate.check_shard", replacing)
    with pytest.raises(BusyError, match="replaced while it was read; open it again") as error:
        validate(copied)
    assert error.value.exit_code == 75
