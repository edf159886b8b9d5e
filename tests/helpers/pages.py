"""The code of the documentation, run as a reader would."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import ibdata
from helpers import ROOT

USE_WITH = (ROOT / "docs" / "use-with.md").read_text()
STEPS = 100  # of an episode; the datasets of use-with.md have 1000
Snippets = Callable[[str], list[dict[str, Any]]]


def blocks(text: str, language: str) -> list[str]:
    """The code of a page in one language, a text each."""
    return re.findall(rf"^```{language}\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)


def check_guide(text: str, folder: Path) -> None:
    """Run the code of a page in a folder; it must print what the page shows."""
    (folder / "page.md").write_text(text, encoding="utf-8")
    command = [sys.executable, str(ROOT / "scripts/guide"), "page.md"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "".join(blocks(text, "text"))


@pytest.fixture(scope="session")
def generated(tmp_path_factory) -> Path:
    """A folder with the two datasets of use-with.md, but with shorter episodes."""
    folder = tmp_path_factory.mktemp("page")
    for name in ("random", "transfer"):
        ibdata.generate(name, folder / "data" / name, workers=1, overrides=[f"steps={STEPS}"])
    return folder


@pytest.fixture
def use_with(generated, tmp_path, monkeypatch) -> Snippets:
    """A function that runs each Python block under a heading of use-with.md, and returns their variables."""
    (tmp_path / "data").symlink_to(generated / "data")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", "put back afterwards")

    def run(heading: str) -> list[dict[str, Any]]:
        section = re.search(
            rf"^## {re.escape(heading)}\n(.*?)(?=^## |\Z)", USE_WITH, re.MULTILINE | re.DOTALL
        )
        assert section is not None, heading
        found = []
        for block in blocks(section[1], "python"):
            names: dict[str, Any] = {}
            exec(compile(block, f"use-with.md, {heading}", "exec"), names)
            found.append(names)
        assert found
        return found

    return run
