"""The code of the guides runs, in order, and prints what they show."""

from __future__ import annotations

import re

import pytest
from helpers import ROOT
from helpers.pages import blocks, check_guide

pytestmark = pytest.mark.slow

PAGES = {path.name: path.read_text(encoding="utf-8") for path in sorted((ROOT / "docs").glob("*.md"))}
# A page that the tests of a bridge name needs the bridge's library; it is run there.
BRIDGES = [*(ROOT / "tests/bridges").rglob("*.py"), ROOT / "tests/helpers/pages.py"]
BRIDGED = "".join(path.read_text(encoding="utf-8") for path in BRIDGES)
GUIDES = {name: text for name, text in PAGES.items() if name not in BRIDGED and blocks(text, "(?:python|sh)")}
GUIDES["mppi.md"] = (ROOT / "studies/mppi.md").read_text(encoding="utf-8")
# The parts of other pages that need no more than the core.
GUIDES["custom-policies.md"] = PAGES["custom-policies.md"].partition("## A recurrent policy of SB3")[0]
GUIDES["scale.md"] = re.search(r"^## Several hosts.*?(?=^## Ray)", PAGES["scale.md"], re.M | re.S)[0]


@pytest.mark.parametrize("guide", GUIDES)
def test_the_code_of_a_guide_prints_what_it_says(guide, tmp_path):
    check_guide(GUIDES[guide], tmp_path)


def test_the_guides_are_found():
    assert {"index.md", "experiments.md", "evaluation.md", "datasets.md"} <= set(GUIDES)
    assert "use-with.md" not in GUIDES
