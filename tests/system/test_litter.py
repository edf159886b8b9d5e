"""What macOS leaves beside a dataset's files, ._* and .DS_Store, never matters."""

import shutil
from pathlib import Path

import duckdb
import pandas as pd
import polars as pl
import pytest
from helpers.folders import contents, litter

import ibdata
from ibdata._system.files import paths_in
from ibdata.tools.listing import datasets_in


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
