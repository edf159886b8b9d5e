"""A place is where it was when it was opened, and ~ is the user's folder, wherever a path is given."""

import os
import pickle
import shutil
from pathlib import Path

import pytest
from helpers.datasets import FOUR_SHARDS as TINY
from helpers.folders import contents
from helpers.splits import HALVES

import ibdata
from ibdata.errors import DatasetError
from ibdata.experiment.catalogue import write_template
from ibdata.tools.card import card
from ibdata.tools.listing import datasets_in
from ibdata.tools.split_schemes import leave_one_out


@pytest.fixture(autouse=True)
def home(tiny, tmp_path, monkeypatch):
    """An empty current folder, beside the user's folder with a dataset."""
    shutil.copytree(tiny[0].path, tmp_path / "home/d")
    (tmp_path / "here").mkdir()
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path / "home"


def test_a_dataset_stays_where_it_was_opened(home, monkeypatch):
    monkeypatch.chdir(home)
    dataset = ibdata.open("d")
    monkeypatch.chdir("..")
    assert len(pickle.loads(pickle.dumps(dataset)).table()) == 20
    assert ibdata.split(dataset, HALVES).place == dataset.place == "d"
    assert set(dataset.splits) == {"train", "test"}


def test_a_tilde_is_the_user_s_folder(home):
    ibdata.generate(TINY, "~/x", workers=1, shards="1/1")
    ibdata.finalize("~/x")
    ibdata.generate(TINY, Path("~/e"), seed=7, workers=1)
    ibdata.merge(["~/d", Path("~/e")], "~/both")
    ibdata.export("~/d", "npz", "~/x.npz")
    ibdata.open("~/d").windows(folder="~/windows")
    write_template("~/x.yaml")
    assert sorted(os.listdir(home)) == ["both", "d", "e", "windows", "x", "x.npz", "x.yaml"]
    assert ibdata.validate("~/d") == ibdata.repair("~/d") == ibdata.reproduce("~/d")[1] == []
    assert len(datasets_in("~")) == 4
    experiment = ibdata.load("~/d/meta/experiment.yaml")
    assert ibdata.estimate(experiment, out="~/d")["action"] == "open the finished dataset"
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
    "split": lambda place: ibdata.split(place, HALVES),
    "materialize": lambda place: ibdata.split(place, leave_one_out(ibdata.open(place)), materialize="copy"),
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


def test_a_plain_name_may_be_read_in_data_and_nothing_else_is_looked_for_there(project):
    for read in READING.values():
        for name in ("mine", Path("a/b")):
            assert not read(name)  # no split, no problem
    for use in (*READING.values(), *WRITING.values()):
        for place in ("../other", "a/../mine", f"{os.getcwd()}/mine"):
            assert NOWHERE in refused(use, place)


def test_a_writer_does_not_look_in_data(project):
    for write in WRITING.values():
        for name in ("mine", Path("mine")):
            assert refused(write, name) == f"mine: {NOWHERE}; did you mean 'data/mine'?"
