"""Fixtures that run the snippets of docs/use-with.md in a folder with the datasets that they read."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import ibdata
from helpers import ROOT

TEXT = (ROOT / "docs" / "use-with.md").read_text()
STEPS = 100  # of an episode; the page's datasets have 1000
Snippets = Callable[[str], list[dict[str, Any]]]


@pytest.fixture(scope="session")
def generated(tmp_path_factory) -> Path:
    """A folder with the two datasets of the page, but with shorter episodes."""
    folder = tmp_path_factory.mktemp("page")
    for name in ("random", "transfer"):
        ibdata.generate(name, folder / "data" / name, workers=1, overrides=[f"steps={STEPS}"])
    return folder


@pytest.fixture
def use_with(generated, tmp_path, monkeypatch) -> Snippets:
    """A function that runs each Python block under a heading on its own, and returns their variables."""
    (tmp_path / "data").symlink_to(generated / "data")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", "put back afterwards")

    def run(heading: str) -> list[dict[str, Any]]:
        section = re.search(rf"^## {re.escape(heading)}\n(.*?)(?=^## |\Z)", TEXT, re.MULTILINE | re.DOTALL)
        assert section is not None, heading
        found = []
        for block in re.findall(r"^```python\n(.*?)^```$", section[1], re.MULTILINE | re.DOTALL):
            names: dict[str, Any] = {}
            exec(compile(block, f"use-with.md, {heading}", "exec"), names)
            found.append(names)
        assert found
        return found

    return run
