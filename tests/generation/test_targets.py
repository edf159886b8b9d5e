"""The places at which a dataset can be made, and those that are refused before the first row."""

import os
import shutil
from pathlib import Path

import pytest
from helpers.datasets import FOUR_SHARDS as TINY
from helpers.folders import contents
from helpers.refusals import refused

import ibdata
from ibdata.tools.split_schemes import leave_one_out

WRITERS = {
    "generate": lambda out: ibdata.generate(TINY, out, workers=1),
    "overwrite": lambda out: ibdata.generate(TINY, out, workers=1, overwrite=True),
    "shards": lambda out: ibdata.generate(TINY, out, shards="1/1", workers=1),
    "materialize": lambda out: ibdata.split("../a", leave_one_out(ibdata.open("../a")), materialize=out),
}
REFUSED = {
    "current": (".", "is the current folder or around it"),
    "around": ("..", "is the current folder or around it"),
    "mount": ("/proc", "is a mount point"),
    "file": ("file", "is a file, not a folder"),
    "folder": ("folder", "not a dataset of ibdata, left as it is|exists already"),
    "in a link": ("linked/more", "lies within the dataset .*a; choose a place outside"),
    "Column": ("runs/Policy=safe/x", "found the folder Policy=safe, .*; choose another name"),
    "column's link": ("STEP=1", "found the folder STEP=1, .*; choose another name"),
    "one file": ("runs/x.Parquet", r"found the ending .parquet, but a dataset is a folder"),
    "NUL": ("a\0b", "expected a path without NUL"),
}


@pytest.fixture(autouse=True)
def here(tiny, tmp_path, monkeypatch):
    """An empty current folder, beside two datasets."""
    (tmp_path / "here").mkdir()
    shutil.copytree(tiny[0].path, tmp_path / "a")
    shutil.copytree(tiny[1].path, tmp_path / "b")
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path


@pytest.mark.parametrize(("out", "line"), REFUSED.values(), ids=REFUSED)
def test_a_place_that_cannot_be_a_dataset_is_refused(here, out, line):
    for folder in ("folder", "scratch"):
        Path(folder).mkdir()
    for file in ("file", "folder/mine"):
        Path(file).write_text("mine")
    Path("linked").symlink_to("../a/meta")
    Path("STEP=1").symlink_to("scratch")
    before = contents(here)
    for write in WRITERS.values():
        refused(line, write, out)
    assert contents(here) == before


FREE = {
    "new": ("a/b/c", "a/b/c"),
    "empty": ("empty", "empty"),
    "link to empty": ("to-empty", "empty"),
    "dangling link": ("to-new", "scratch/new"),
    "through a link": ("scratch-link/new", "scratch/new"),
}
LINKS = {"to-empty": "empty", "to-new": "scratch/new", "scratch-link": "scratch"}


@pytest.mark.parametrize(("out", "place"), FREE.values(), ids=FREE)
def test_links_and_empty_folders_are_places(out, place):
    for folder in ("empty", "scratch"):
        Path(folder).mkdir()
    for link, to in LINKS.items():
        Path(link).symlink_to(to)
    assert len(WRITERS["generate"](out)) == 20
    assert Path(place, "meta/manifest.json").is_file()
    assert {str(path): os.readlink(path) for path in Path().iterdir() if path.is_symlink()} == LINKS
    assert not list(Path().rglob(".*"))


def test_overwriting_names_what_is_not_the_dataset_s():
    for name in ("data/mine.parquet", "more/"):
        path = Path("../a", name)
        path.mkdir() if name.endswith("/") else path.write_text("mine")
        before = contents("../a")
        refused("found a (file|folder) that is not the dataset's; move it away", WRITERS["overwrite"], "../a")
        assert contents("../a") == before
        path.rmdir() if name.endswith("/") else path.unlink()


@pytest.mark.parametrize("name", [".new.part", ".new.part/mine"])
def test_what_ibdata_did_not_make_is_no_part_of_a_run(name):
    Path(name).parent.mkdir(exist_ok=True)
    Path(name).write_text("mine")
    before = contents()
    for write in WRITERS.values():
        refused(r"\.new\.part: found what ibdata did not make, .*; move it", write, "new")
    assert contents() == before
