"""What macOS leaves beside a dataset's files, ._* and .DS_Store, never matters."""

import shutil
from pathlib import Path

import duckdb
import pandas as pd
import polars as pl
import pytest
from helpers.datasets import FOUR_SHARDS, TEN_SHARDS
from helpers.folders import contents, litter, part_of

import ibdata
from ibdata.errors import UsageError
from ibdata.maintenance.listing import datasets_in
from ibdata.system.files import paths_in


@pytest.fixture
def littered(tiny, tmp_path):
    folder = Path(shutil.copytree(tiny[0].path, tmp_path / "set/littered"))
    litter(folder)
    assert len(list((folder / "data").glob("._part-*.parquet"))) == 4
    return folder


def test_only_its_files_are_passed_over(tmp_path):
    for name in (".DS_Store", "._a", ".a", "a", "_a"):
        (tmp_path / name).write_text("")
    (tmp_path / "._folder").mkdir()
    assert [path.name for path in paths_in(tmp_path)] == ["._folder", ".a", "_a", "a"]


def test_a_dataset_is_whole_and_read(littered, tiny):
    before, table = contents(littered), tiny[0].table()
    assert ibdata.validate(littered) == ibdata.validate(littered, quick=True) == []
    assert ibdata.repair(littered, workers=1) == []
    assert ibdata.validate(littered.as_uri()) == []
    assert contents(littered) == before
    assert ibdata.open(littered).table().equals(table)
    expected = table["reward"].to_pylist()
    assert pd.read_parquet(littered / "data")["reward"].tolist() == expected
    assert pl.read_parquet(f"{littered}/data/part-*.parquet")["reward"].to_list() == expected
    with duckdb.connect() as connection:
        rows = connection.sql(f"select reward from '{littered}/data/part-*.parquet'").fetchall()
    assert [reward for (reward,) in rows] == expected
    assert [listed.state for listed in datasets_in(littered.parent)] == ["finished"]


def test_a_lost_file_is_made_again(littered, shard_file):
    path = shard_file(littered, 1)
    (littered / path).unlink()
    assert ibdata.repair(littered, workers=1) == [path]


def test_a_dataset_is_split_merged_and_exported(littered, tiny, tmp_path):
    assert set(ibdata.split(littered, by="episode", fractions=[0.5, 0.5]).splits) == {"train", "test"}
    copy = ibdata.split(littered, materialize=tmp_path / "copy")
    assert copy.content_root == tiny[0].content_root
    merged = ibdata.merge([littered, tiny[1].path], tmp_path / "merged")
    assert len(merged) == len(tiny[0]) + len(tiny[1])
    for overwrite in (False, True):
        ibdata.export(littered, to="rllib", out=tmp_path / "rllib", overwrite=overwrite)
        litter(tmp_path / "rllib")
    (tmp_path / "rllib/mine").write_text("")
    with pytest.raises(UsageError, match="found mine, which is not of such an export"):
        ibdata.export(littered, to="rllib", out=tmp_path / "rllib", overwrite=True)


def test_a_dataset_is_opened_replaced_and_made_in_a_littered_folder(littered, tmp_path):
    assert ibdata.generate(FOUR_SHARDS, littered, workers=1).path == littered
    made = ibdata.generate(TEN_SHARDS, littered, workers=1, overwrite=True)
    assert ibdata.validate(made.path) == []
    assert len(made) == 50
    empty = tmp_path / "empty"
    empty.mkdir()
    litter(empty)
    assert len(ibdata.generate(FOUR_SHARDS, empty, workers=1)) == 20
    assert not part_of(empty).exists()


def test_a_run_goes_on_among_litter(tmp_path, monkeypatch):
    out = tmp_path / "x"
    with monkeypatch.context() as patch:
        patch.setattr("ibdata.generation.build.finish", None)  # so that all shards are made, and nothing more
        with pytest.raises(TypeError):
            ibdata.generate(FOUR_SHARDS, out, workers=1)
    litter(part_of(out))
    assert [listed.state for listed in datasets_in(tmp_path)] == ["unfinished, 4 of 4 shards"]
    assert ibdata.validate(ibdata.generate(FOUR_SHARDS, out, workers=1).path) == []
    assert not part_of(out).exists()


def test_a_folder_of_experiments_holds_no_more_of_them(tmp_path):
    (tmp_path / "a.yaml").write_text("{name: a, setpoints: 70, policies: [random]}")
    (tmp_path / "._a.yaml").write_bytes(b"\0\5\x16\7 Mac OS X")
    assert [experiment.name for experiment in ibdata.experiment.load_all(tmp_path)[1]] == ["a"]
