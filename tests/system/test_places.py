"""A place is where it was when it was opened, and ~ is the user's folder, wherever a path is given."""

import os
import pickle
import shutil
from pathlib import Path

import pytest
from helpers.datasets import FOUR_SHARDS as TINY
from helpers.folders import contents

import ibdata
from ibdata.errors import DatasetError
from ibdata.experiment.catalogue import write_template
from ibdata.tools.card import card
from ibdata.tools.listing import datasets_in

READS = {
    "rows": lambda ds: len(ds.table()),
    "splits": lambda ds: ds.splits,
    "pickle": lambda ds: len(pickle.loads(pickle.dumps(ds)).table()),
    "split": lambda ds: ibdata.split(ds, "episode", fractions=(0.5, 0.5)).place,
}


@pytest.fixture(autouse=True)
def home(tiny, tmp_path, monkeypatch):
    """An empty current folder, beside the user's folder with a dataset."""
    shutil.copytree(tiny[0].path, tmp_path / "home/d")
    (tmp_path / "here").mkdir()
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path / "home"


@pytest.mark.parametrize("read", READS.values(), ids=READS)
def test_a_dataset_stays_where_it_was_opened(home, monkeypatch, read):
    monkeypatch.chdir(home)
    before = read(ibdata.open("d"))
    dataset = ibdata.open("d")
    monkeypatch.chdir("..")
    assert read(dataset) == before
    assert dataset.place == "d"


WRITES = {  # and a file that each makes in the user's folder
    "generate": (lambda out: ibdata.generate(TINY, out, workers=1), "x/README.md"),
    "shards": (
        lambda out: (ibdata.generate(TINY, out, workers=1, shards="1/1"), ibdata.finalize(out)),
        "x/README.md",
    ),
    "merge": (
        lambda out: ibdata.merge(["~/d", ibdata.generate(TINY, "~/e", seed=7, workers=1)], out),
        "x/README.md",
    ),
    "export": (lambda out: ibdata.export("~/d", "npz", out), "x"),
    "windows": (lambda out: ibdata.open("~/d").windows(folder=out), "x/windows.json"),
    "init": (write_template, "x"),
}


@pytest.mark.parametrize(("write", "file"), WRITES.values(), ids=WRITES)
def test_a_tilde_is_the_user_s_folder(home, write, file):
    write(Path("~/x"))
    assert (home / file).is_file()
    assert os.listdir() == []


READERS = {
    "open": lambda: len(ibdata.open("~/d")),
    "validate": lambda: ibdata.validate("~/d"),
    "repair": lambda: ibdata.repair("~/d"),
    "reproduce": lambda: ibdata.reproduce("~/d"),
    "ls": lambda: datasets_in("~"),
    "load": lambda: ibdata.load("~/d/meta/experiment.yaml"),
    "dry run": lambda: ibdata.estimate("~/d/meta/experiment.yaml", out="~/d"),
}


@pytest.mark.parametrize("read", READERS.values(), ids=READERS)
def test_a_tilde_is_read_too(read):
    read()
    assert os.listdir() == []


@pytest.fixture
def project(home, tmp_path, monkeypatch):
    """The current folder, with the datasets data/mine, data/a/b and other, which is data/../other too."""
    for name in ("data/mine", "data/a/b", "other"):
        shutil.copytree(home / "d", tmp_path / "project" / name)
    monkeypatch.chdir(tmp_path / "project")


READING = {
    "open": lambda place: ibdata.open(place).splits,
    "validate": lambda place: list(map(str, ibdata.validate(place))),
    "reproduce": lambda place: ibdata.reproduce(place, 1)[1],
    "export": lambda place: ibdata.export(place, "npz", "out.npz", overwrite=True).left_out,
}
WRITING = {
    "split": lambda place: ibdata.split(place, "episode", fractions=(0.5, 0.5)),
    "materialize": lambda place: ibdata.split(place, "setpoint", scheme="leave-one-out", materialize="copy"),
    "card": card,
    "repair": ibdata.repair,
}
NOWHERE = "no finished dataset here: meta/manifest.json is missing"


def refused(use, place):
    """What a function says of a place at which there is no dataset, and nothing is written then."""
    before = contents()
    try:
        said = " ".join(use(place))
    except DatasetError as error:
        said = str(error)
    assert contents() == before
    return said


@pytest.mark.parametrize("read", READING.values(), ids=READING)
def test_a_plain_name_may_be_read_in_data(project, read):
    for name in ("mine", Path("a/b")):
        assert not read(name)  # no split, no problem


@pytest.mark.parametrize("place", ["../other", "a/../mine", "{}/mine"])
@pytest.mark.parametrize("use", [*READING.values(), *WRITING.values()], ids=[*READING, *WRITING])
def test_no_other_place_is_looked_for_in_data(project, use, place):
    assert NOWHERE in refused(use, place.format(os.getcwd()))


@pytest.mark.parametrize("write", WRITING.values(), ids=WRITING)
def test_a_writer_does_not_look_in_data(project, write):
    for name in ("mine", Path("mine")):
        assert refused(write, name) == f"mine: {NOWHERE}; did you mean 'data/mine'?"
