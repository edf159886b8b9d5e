"""`ibdata figure` and `ibdata.plots.figure`: complete files, equal in every run, and helpful errors."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from xml.etree import ElementTree

import matplotlib
import pytest
from PIL import Image

from ibdata.dynamics import VARIANTS
from ibdata.errors import UsageError
from ibdata.plots import DYNAMICS, figure, names

pytestmark = pytest.mark.slow

FIGURES = ["dynamics", "landscape", "policies", "setpoints"]


def test_the_figures_are_these():
    assert names() == FIGURES
    assert tuple(VARIANTS) == DYNAMICS


@pytest.mark.parametrize("name", FIGURES)
def test_command_and_python_draw_the_same_png(ibdata, tmp_path, name):
    done = ibdata("figure", name)
    assert (done.returncode, done.stdout, done.stderr) == (0, f"figures/{name}.png\n", "")
    made = tmp_path / "figures" / f"{name}.png"
    with Image.open(made) as picture:
        picture.load()
        assert picture.format == "PNG"
        assert min(picture.size) > 300
        assert "Software" not in picture.info
    again = figure(name, tmp_path / "again.png")
    assert again.read_bytes() == made.read_bytes()
    assert sorted(os.listdir(made.parent)) == [made.name]


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_called_svg_is_one_with_named_axes(tmp_path, name):
    paths = [figure(name, tmp_path / f"{i}.SVG") for i in range(2)]
    assert paths[0].read_bytes() == paths[1].read_bytes()
    text = paths[0].read_text()
    assert ElementTree.fromstring(text).tag == "{http://www.w3.org/2000/svg}svg"
    assert "<dc:date>" not in text
    label = {"landscape": "direction φ", "policies": "direction φ"}.get(name, "step t")
    assert f"<!-- {label} -->" in text


def test_the_user_s_settings_of_matplotlib_do_not_matter(tmp_path):
    plain = figure("setpoints", tmp_path / "plain.png").read_bytes()
    with matplotlib.rc_context({"lines.linewidth": 9, "font.size": 20, "axes.facecolor": "red"}):
        before = dict(matplotlib.rcParams)
        assert figure("setpoints", tmp_path / "mine.png").read_bytes() == plain
        assert dict(matplotlib.rcParams) == before


def test_variant_and_seed_are_those_asked_for(ibdata, tmp_path):
    options = ({}, {"dynamics": "paper"}, {"seed": 3})
    made = [figure("setpoints", tmp_path / f"{i}.png", **given) for i, given in enumerate(options)]
    assert len({path.read_bytes() for path in made}) == 3
    assert ibdata("figure", "setpoints", "--dynamics", "paper", "--out", "c.png").returncode == 0
    assert (tmp_path / "c.png").read_bytes() == made[1].read_bytes()


def test_a_file_that_exists_is_replaced_only_when_told_to(ibdata, tmp_path):
    (tmp_path / "mine.png").write_text("mine")
    refused = ibdata("figure", "setpoints", "--out", "mine.png")
    assert (refused.returncode, refused.stdout) == (2, "")
    assert refused.stderr == ("mine.png: exists already; choose another name, or --overwrite\n")
    assert (tmp_path / "mine.png").read_text() == "mine"
    done = ibdata("figure", "setpoints", "--out", "mine.png", "--overwrite", "--json")
    assert json.loads(done.stdout) == {"version": 1, "files": ["mine.png"]}
    assert (tmp_path / "mine.png").read_bytes().startswith(b"\x89PNG")
    (tmp_path / "link.png").symlink_to("nowhere")
    with pytest.raises(UsageError, match="exists already"):
        figure("setpoints", tmp_path / "link.png")
    (tmp_path / "a.png").mkdir()
    with pytest.raises(UsageError, match=r"exists already; choose another name$"):
        figure("setpoints", tmp_path / "a.png", overwrite=True)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"name": "landscap"},
            f"figure: found 'landscap', expected one of {', '.join(FIGURES)}",
        ),
        ({"out": "a.pdf"}, "a.pdf: found the ending '.pdf', expected .png or .svg"),
        ({"out": "figures"}, "figures: found the ending '', expected .png or .svg"),
        ({"dynamics": "simens"}, "dynamics: found 'simens', expected one of siemens, paper"),
        ({"seed": -1}, "seed: found -1, expected a whole number from 0 to 2⁶⁴ - 1"),
        ({"seed": 2**64}, f"seed: found {2**64}, expected a whole number from 0 to 2⁶⁴ - 1"),
    ],
)
def test_what_cannot_be_meant_is_refused_first(tmp_path, monkeypatch, given, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError) as caught:
        figure(**{"name": "setpoints", **given})
    assert str(caught.value) == message
    assert os.listdir(tmp_path) == []


def test_without_matplotlib_the_command_says_what_to_install(tmp_path):
    code = "import sys; sys.modules['matplotlib'] = None; from ibdata.cli import main; main(sys.argv[1:])"
    done = subprocess.run(
        [sys.executable, "-c", code, "figure", "landscape"], cwd=tmp_path, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (1, "")
    needed = "ibdata.plots needs the package matplotlib: pip install matplotlib, or 'ibdata[plot]'"
    assert done.stderr == f"ibdata: {needed}\n"
    assert os.listdir(tmp_path) == []
