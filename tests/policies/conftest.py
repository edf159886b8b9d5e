"""A file of a network in the current folder."""

from __future__ import annotations

import pytest
from helpers.networks import actor


@pytest.fixture
def network_here(tmp_path, monkeypatch):
    """A file `actor.safetensors` in the current folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "actor.safetensors").write_bytes(actor())
