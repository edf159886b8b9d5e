"""`studies/figures` draws the shipped pictures, and the paper's figures show the numbers of the dynamics."""

from __future__ import annotations

import re
import runpy

import matplotlib
import numpy as np
import pytest
from helpers import ROOT
from PIL import Image

import measuring.documents

pytestmark = pytest.mark.slow

NAMES = ["picture", *(f"figures/{name}" for name in ("landscape", "policies", "dynamics", "setpoints"))]
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


@pytest.mark.parametrize("name", NAMES)
def test_the_study_draws_the_shipped_pictures(study, name):
    """Another seed changes at least 1 % of the pixels, and another matplotlib, whose fonts differ, 2 %."""
    made, shipped = greys(study / f"{name}.png"), greys(ROOT / f"docs/{name}.png")
    assert made.shape == shipped.shape
    if matplotlib.__version__ in PINNED:
        assert (abs(made - shipped) > 64).mean() < 0.001
