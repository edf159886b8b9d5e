"""`ibdata plot` and `studies/figures`: complete files, equal in every run, and helpful errors."""

from __future__ import annotations

import json
import os
import re
import runpy

import matplotlib
import numpy as np
import pytest
from helpers import ROOT
from helpers.refusals import refused
from PIL import Image

import measuring.documents
from ibdata.errors import DatasetError, IbdataError
from ibdata.plots import PICTURES, plot

pytestmark = pytest.mark.slow

NAMES = ["actions", "coverage", "returns", "rewards", "splits", "traces", "tradeoff"]


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_every_form_of_dataset_is_drawn_into_whole_pictures(any_form, tmp_path):
    paths = plot(any_form, tmp_path / "a")
    split = bool(any_form.splits)
    assert paths == [tmp_path / "a" / f"{name}.png" for name in NAMES if split or name != "splits"]
    for path in paths:
        with Image.open(path) as picture:
            picture.load()
            assert (picture.format, picture.width >= 720, picture.height > 250) == ("PNG", True, True)


def test_the_command_draws_what_python_draws(ibdata, merged, tmp_path):
    (tmp_path / "figures" / "both").mkdir(parents=True)
    (tmp_path / "figures" / "both" / "traces.png").write_text("mine")
    refused = ibdata("plot", str(merged.path))
    assert (refused.returncode, refused.stdout) == (2, "")
    expected = "exists already; choose another --out, or --overwrite to replace it"
    assert refused.stderr == f"figures/both/traces.png: {expected}\n"
    assert os.listdir(tmp_path / "figures" / "both") == ["traces.png"]
    done = ibdata("plot", str(merged.path), "--overwrite")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "".join(f"figures/both/{name}.png\n" for name in NAMES)
    plot(merged, tmp_path / "again")
    assert contents(tmp_path / "again") == contents(tmp_path / "figures" / "both")
    assert list(PICTURES) == NAMES


def test_svg_has_names_and_units_on_its_axes(ibdata, many, tmp_path):
    done = ibdata("plot", str(many.path), "--out", "svg", "--format", "svg", "--json")
    assert json.loads(done.stdout) == {"version": 1, "files": [f"svg/{name}.svg" for name in NAMES]}
    texts = {path.stem: path.read_text() for path in (tmp_path / "svg").iterdir()}
    assert sorted(texts) == NAMES
    assert all(": many -->" in text for text in texts.values())
    assert "<!-- fatigue f, at t + 1 (cost units) -->" in texts["tradeoff"]
    assert "<!-- velocity v, at t -->" in texts["coverage"]
    assert "<!-- setpoint p -->" in texts["rewards"]


def test_links_and_folders_in_the_way_are_not_replaced(merged, tmp_path):
    (tmp_path / "actions.png").symlink_to("nowhere")
    refused("exists already", plot, merged, tmp_path)
    (tmp_path / "splits.png").mkdir()
    refused(r"splits\.png: exists already; choose another out$", plot, merged, tmp_path, overwrite=True)


def test_what_cannot_be_meant_is_refused_first(merged, tmp_path):
    refused("form: found 'pdf', expected one of png, svg", plot, merged, tmp_path / "a", form="pdf")
    refused("no finished dataset here", plot, tmp_path / "none", tmp_path / "a", error=DatasetError)
    (tmp_path / "file").write_text("")
    with pytest.raises(IbdataError, match=r"file/actions\.png: cannot be written: ") as caught:
        plot(merged, tmp_path / "file")
    assert caught.value.exit_code == 1
    assert os.listdir(tmp_path) == ["file"]


SHIPPED = ["picture", *(f"figures/{name}" for name in ("landscape", "policies", "dynamics", "setpoints"))]
PINNED = re.findall(r"^matplotlib==(\S+)", (ROOT / "constraints.txt").read_text(), re.MULTILINE)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A folder in which the study has drawn."""
    folder = tmp_path_factory.mktemp("docs")
    (folder / "figures").mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(measuring.documents, "DOCS", folder)
        runpy.run_path(str(ROOT / "studies/figures"), run_name="__main__")
    return folder


def greys(path):
    with Image.open(path) as picture:
        assert "Software" not in picture.info  # the version of matplotlib
        return np.array(picture.convert("L"), dtype=int)


@pytest.mark.parametrize("name", SHIPPED)
def test_the_study_draws_the_shipped_pictures(study, name):
    """Another seed changes at least 1 % of the pixels, and another matplotlib, whose fonts differ, 2 %."""
    made, shipped = greys(study / f"{name}.png"), greys(ROOT / f"docs/{name}.png")
    assert made.shape == shipped.shape
    if matplotlib.__version__ in PINNED:
        assert (abs(made - shipped) > 64).mean() < 0.001
