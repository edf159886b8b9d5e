"""The README is short, its commands and lines run, and its figures stand in the pages that prove them."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from helpers import ROOT
from helpers.pages import check_guide

from ibdata.exporters import FORMATS

TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```$", TEXT, flags=re.MULTILINE | re.DOTALL)
SHELL = [line for language, block in BLOCKS if language == "sh" for line in block.splitlines()]
PROVEN = "".join((ROOT / "docs" / page).read_text(encoding="utf-8") for page in ("promises.md", "errata.md"))


def test_it_is_short_and_begins_with_the_two_commands():
    assert len(TEXT.split()) <= 750
    assert SHELL[0].endswith("ibdata generate --config random.yaml")
    assert SHELL[1] == "scripts/test"
    assert "README.md" in (ROOT / ".ci/run").read_text()


@pytest.mark.slow
def test_the_lines_of_your_own_experiment_print_what_they_say(tmp_path: Path):
    section = TEXT[TEXT.index("## Your own") : TEXT.index("## Paper or siemens?")]
    check_guide(section, tmp_path)


@pytest.mark.parametrize(
    "figure", ["1e-12", "100,000", "3,262", "185", "5,913", "727", "166", "338", "8 and 6"]
)
def test_a_measured_figure_stands_where_its_proof_is(figure: str):
    """The medians of the run-away are 338, 205 and 166 steps by the code, and 8, 7 and 6 as printed."""
    assert figure in TEXT
    assert {"8 and 6": "8 / 7 / 6"}.get(figure, figure) in PROVEN


def test_the_speed_is_the_one_that_was_measured():
    measured = (ROOT / "docs/performance.md").read_text(encoding="utf-8")
    ratio = re.search(r"^\| one processor, .* published package .*? \| (\d+) × \|", measured, re.MULTILINE)[1]
    low, high = map(int, re.search(r"(\d+) to (\d+) times, by machine", measured).groups())
    assert low <= int(ratio) <= high
    assert "about 100 times as fast as the published package" in " ".join(TEXT.split())
    each = int(re.search(r"^\| 10,000,000 transitions \| (\d+) ns each", measured, re.MULTILINE)[1])
    assert f"{math.floor(10_000 / each) / 10} million transitions a second" in TEXT


def test_the_columns_and_formats_are_those_that_exist():
    assert f"{len(FORMATS)} export formats" in " ".join(TEXT.split())
    page = (ROOT / "docs/dataset-format.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`.+?) \|", TEXT, flags=re.MULTILINE)
    named = {name for row in rows for name in re.findall(r"`([\w*]+)`", row)}
    assert len(named) == 11
    assert all(f"`{name.removesuffix('*')}" in page for name in named)
