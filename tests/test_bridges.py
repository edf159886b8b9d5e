"""scripts/bridges runs all tests in tests/bridges."""

from __future__ import annotations

import re
import subprocess

import pytest
from helpers import ROOT

FILES = sorted((ROOT / "scripts/bridges.d").iterdir())


def bridges(*args: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([ROOT / "scripts/bridges", *args], capture_output=True, text=True)


def test_every_folder_of_tests_has_a_bridge():
    folders = {path.name for path in (ROOT / "tests/bridges").iterdir()}
    assert {path.stem.partition("-")[0] for path in FILES} == folders


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_bridge_is_made_of_extras_and_pins(path):
    project, *pins = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    extras = re.findall(r"^(\w+) = \[", (ROOT / "pyproject.toml").read_text(), flags=re.MULTILINE)
    assert path.suffix == ".txt"
    assert set(re.fullmatch(r"\.\[(.+)\]", project)[1].split(",")) <= set(extras)
    assert pins
    assert all(re.fullmatch(r"[\w.-]+==[\w.]+", pin) for pin in pins)


def test_the_script_lists_them_and_says_where_one_is_unknown():
    assert bridges("--list").stdout.split() == [path.stem for path in FILES]
    wrong = bridges("gymnasium")
    assert wrong.returncode != 0
    assert "Sessions not found: gymnasium" in wrong.stdout
    assert "passed" not in wrong.stdout
