"""A mistake that people make says what to write."""

import os

import numpy as np
import pytest
from helpers.refusals import refused

import ibdata
from ibdata.errors import IbdataError, Interrupted

PLAIN = {"name": "x", "setpoints": 70, "policies": ["random"], "steps": 10}


class Mine:
    def predict(self, observations):
        assert observations.shape[1] == 180
        return observations[:, :3]


def test_a_class_is_to_be_made_an_object():
    line = r"^policies\.0: found the class Mine, expected an object: Mine\(…\)$"
    refused(line, ibdata.load, {**PLAIN, "policies": [Mine]})


def test_a_file_is_named_with_its_ending(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text("name: mine")
    refused(r"config: found 'mine'; did you mean 'mine\.yaml'\?", ibdata.generate, "mine")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return ibdata.generate(PLAIN, tmp_path_factory.mktemp("made") / "x")


@pytest.mark.parametrize(
    ("call", "line"),
    [
        (lambda ds: ibdata.evaluate(["random"], "50,70"), "write [50, 70]"),
        (lambda ds: ibdata.evaluate(os.fspath(ds.path)), "; ibdata info shows a dataset"),
        (lambda ds: ibdata.evaluate(Mine()), "(32, 6); history= gives more than one"),
        (lambda ds: ibdata.rollouts(ds, rows=[0], actions=np.zeros((5, 2))), "found shape (5, 2): array("),
        (lambda ds: ds["reward"], "; to_pandas()['reward'] is a column"),
        (lambda ds: ds.plot(), "a dataset has no plot; ibdata.card, export, plots.plot "),
        (lambda ds: ds.export("npz"), "a dataset has no export; ibdata.card, export"),
    ],
)
def test_a_call_that_is_made_in_another_way(made, call, line):
    with pytest.raises((IbdataError, TypeError, AttributeError)) as found:
        call(made)
    assert line in str(found.value)


def test_a_folder_that_is_gone_is_not_to_be_repaired(tmp_path):
    gone = ibdata.generate(PLAIN, tmp_path / "x")
    (tmp_path / "x").rename(tmp_path / "y")
    refused("missing$", gone.arrays, error=IbdataError)


def test_a_signal_of_the_keyboard_is_named_by_its_keys():
    assert str(Interrupted(2)).startswith("stopped by Ctrl-C; ")
