"""Files in the current folder: a module with custom policies, a network."""

from __future__ import annotations

import sys

import pytest
from helpers.networks import actor
from helpers.own_code import CODE


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """A module `mine` in the current folder."""
    (tmp_path / "mine.py").write_text(CODE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    return tmp_path


@pytest.fixture
def network_here(tmp_path, monkeypatch):
    """A file `actor.safetensors` in the current folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "actor.safetensors").write_bytes(actor())
