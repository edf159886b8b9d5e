"""A module with custom policies in the current folder."""

from __future__ import annotations

import sys

import pytest
from helpers.custom_policies import CODE


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """A module `mine` in the current folder, forgotten afterwards."""
    (tmp_path / "mine.py").write_text(CODE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield tmp_path
    sys.modules.pop("mine", None)
