"""Fixtures for tests of custom policies that are evaluated."""

from __future__ import annotations

import sys

import pytest
from helpers.versions import POLICY


@pytest.fixture
def version(tmp_path, monkeypatch):
    """`version(name, size)` writes a policy and its helper into a folder and returns the path of the YAML."""
    monkeypatch.setattr(sys, "path", list(sys.path))

    def written(name, size):
        folder = tmp_path / name
        folder.mkdir(exist_ok=True)
        (folder / f"own_{name}.py").write_text(POLICY)
        (folder / "size_of_version.py").write_text(f"SIZE = {size}\n")
        (folder / "own.yaml").write_text(f"kind: custom\ntarget: own_{name}.py:Own\n")
        return folder / "own.yaml"

    yield written
    for module in ("size_of_version", "own_one", "own_two"):
        sys.modules.pop(module, None)
