"""The places of files and their greatest length."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from helpers import ROOT

PACKAGE = ROOT / "ibdata"
LONGEST = 290  # lines; most files have fewer than 200
AT_THE_ROOT = {"__init__", "__main__", "errors", "report", "testing", "variables", "version"}
SCRIPTS = [path for path in (ROOT / "scripts").rglob("*") if path.is_file() and path.suffix in ("", ".py")]
DOCUMENTS = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]


def lines(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").splitlines()


def test_no_file_is_too_long_to_be_read_at_once():
    files = [*PACKAGE.rglob("*.py"), *SCRIPTS]
    assert {str(path): len(lines(path)) for path in files if len(lines(path)) > LONGEST} == {}


def test_modules_live_in_rooms():
    assert {path.stem for path in PACKAGE.glob("*.py")} <= AT_THE_ROOT


def test_the_tests_of_a_room_stand_in_a_folder_of_its_name():
    rooms = {path.name for path in PACKAGE.iterdir() if path.is_dir()}
    others = {"bridges", "corpus", "faults", "helpers", "life", "reference", "same_bits"}
    folders = {path.name for path in (ROOT / "tests").iterdir() if any(path.glob("test_*.py"))}
    assert folders - others <= rooms


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_the_paths_that_a_document_names_exist(document):
    """A bare `test_x.py` is a file beside the one named before it."""
    folder, missing = ROOT, []
    for name in re.findall(
        r"`((?:ibdata|tests|scripts|configs|docs|\.ci)/[\w./-]+|test_\w+\.py)`", document.read_text()
    ):
        path = ROOT / name if "/" in name else folder / name
        folder = path.parent
        if not path.exists():
            missing.append(name)
    assert missing == []
