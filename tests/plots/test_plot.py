"""`ibdata plot` and `ibdata.plots.plot`: complete files, equal in every run, and helpful errors."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from xml.etree import ElementTree

import pytest
from PIL import Image

from ibdata.errors import DatasetError, IbdataError, UsageError
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
            assert picture.format == "PNG"
            assert "Software" not in picture.info
            assert min(picture.size) > 250
            assert picture.width >= 720


def test_the_command_draws_what_python_draws(ibdata, merged, tmp_path):
    done = ibdata("plot", str(merged.path))
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
    for text in texts.values():
        assert ": many -->" in text
        assert "<dc:date>" not in text
        assert ElementTree.fromstring(text).tag == "{http://www.w3.org/2000/svg}svg"
    assert "<!-- fatigue f, at t + 1 (cost units) -->" in texts["tradeoff"]
    assert "<!-- velocity v, at t -->" in texts["coverage"]
    assert "<!-- setpoint p -->" in texts["rewards"]
    plot(many, tmp_path / "again", form="svg")
    assert contents(tmp_path / "again") == contents(tmp_path / "svg")


def test_files_that_exist_are_replaced_only_when_told_to(ibdata, merged, tmp_path):
    (tmp_path / "figures" / "both").mkdir(parents=True)
    (tmp_path / "figures" / "both" / "traces.png").write_text("mine")
    refused = ibdata("plot", str(merged.path))
    assert (refused.returncode, refused.stdout) == (2, "")
    expected = "exists already; choose another name, or --overwrite"
    assert refused.stderr == f"figures/both/traces.png: {expected}\n"
    assert os.listdir(tmp_path / "figures" / "both") == ["traces.png"]
    assert ibdata("plot", str(merged.path), "--overwrite").returncode == 0
    assert len(os.listdir(tmp_path / "figures" / "both")) == len(NAMES)
    (tmp_path / "actions.png").symlink_to("nowhere")
    with pytest.raises(UsageError, match="exists already"):
        plot(merged, tmp_path)
    (tmp_path / "splits.png").mkdir()
    with pytest.raises(UsageError, match=r"splits\.png: exists already; choose another name$"):
        plot(merged, tmp_path, overwrite=True)


def test_what_cannot_be_meant_is_refused_first(merged, tmp_path):
    with pytest.raises(UsageError, match="form: found 'pdf', expected one of png, svg"):
        plot(merged, tmp_path / "a", form="pdf")
    with pytest.raises(DatasetError, match="no finished dataset here"):
        plot(tmp_path / "none", tmp_path / "a")
    (tmp_path / "file").write_text("")
    with pytest.raises(IbdataError, match=r"file/actions\.png: cannot be written: ") as caught:
        plot(merged, tmp_path / "file")
    assert caught.value.exit_code == 1
    assert os.listdir(tmp_path) == ["file"]


def test_without_matplotlib_the_command_says_what_to_install(merged, tmp_path):
    code = "import sys; sys.modules['matplotlib'] = None; from ibdata.cli import main; main(sys.argv[1:])"
    done = subprocess.run(
        [sys.executable, "-c", code, "plot", str(merged.path)], cwd=tmp_path, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (1, "")
    needed = "ibdata.plots needs the package matplotlib: pip install matplotlib, or 'ibdata[plot]'"
    assert done.stderr == f"ibdata: {needed}\n"
    assert os.listdir(tmp_path) == []
