"""scripts/bridges runs all tests in tests/bridges."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = sorted((ROOT / "scripts/bridges.d").iterdir())


def bridges(*args: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(ROOT / "scripts/bridges"), *args], capture_output=True, text=True
    )


def words(path: Path, key: str) -> list[str]:
    (line,) = re.findall(rf"^# {key}: (.+)$", path.read_text(), flags=re.MULTILINE)
    return line.split()


def test_every_folder_of_tests_is_run_by_a_bridge():
    folders = {f"tests/bridges/{path.name}" for path in (ROOT / "tests/bridges").iterdir()}
    assert {test for path in FILES for test in words(path, "tests")} == folders


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_bridge_is_made_of_extras_tests_and_pins(path):
    extras = re.findall(r"^(\w+) = \[", (ROOT / "pyproject.toml").read_text(), flags=re.MULTILINE)
    assert path.suffix == ".txt"
    assert set(words(path, "extra")) <= set(extras)
    pins = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    assert pins
    assert all(re.fullmatch(r"[\w.-]+==[\w.]+", pin) for pin in pins)


def test_the_script_lists_them_and_names_them_where_one_is_unknown():
    assert bridges("--list").stdout.split() == [path.stem for path in FILES]
    wrong = bridges("gymnasium")
    assert (wrong.returncode, wrong.stdout) == (2, "")
    assert wrong.stderr == f"found gymnasium, expected some of {', '.join(p.stem for p in FILES)}\n"
