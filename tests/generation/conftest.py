"""Fixtures for tests of array jobs and of runs with a custom policy."""

from __future__ import annotations

import subprocess
import textwrap

import pytest
from helpers.own_code import FILES


@pytest.fixture
def start(command):
    """Start `ibdata generate --shards`, ended with the test."""
    started = []

    def run(text):
        args = ["generate", "-q", "--config", "many.yaml", "--out", "out", "--workers", "1", "--shards", text]
        started.append(
            subprocess.Popen([command, *args], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        )
        return started[-1]

    yield run
    for process in started:
        process.kill()
        process.communicate()


@pytest.fixture
def here(tmp_path, monkeypatch):
    """The current folder, with the policy's files."""
    for path, text in FILES.items():
        (tmp_path / path).write_text(textwrap.dedent(text))
    monkeypatch.chdir(tmp_path)
    return tmp_path
