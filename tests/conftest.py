"""What all tests share: the installed command, run as a user would."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="session")
def command() -> str:
    """The console script that the package installs, beside the Python that runs the tests."""
    return str(Path(sys.executable).parent / "ibdata")


@pytest.fixture
def ibdata(command: str, tmp_path: Path) -> Run:
    """Run `ibdata …` in an empty folder; stdout and stderr apart."""

    def run(
        *args: str, cwd: Path = tmp_path, env: dict[str, str] | None = None
    ) -> subprocess.CompletedProcess[str]:
        return subprocess.run([command, *args], cwd=cwd, env=env, capture_output=True, text=True, timeout=300)

    return run
