"""A fixture for tests of array jobs."""

from __future__ import annotations

import subprocess

import pytest


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
