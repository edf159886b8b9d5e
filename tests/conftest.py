"""What all tests share: the installed command, run as a user would."""

from __future__ import annotations

import runpy
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

# Background jobs of a shell ignore SIGINT, those under nohup SIGHUP, and children would inherit that; what is
# handled here is at its default in them.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, lambda number, frame: None)

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


EPISODES: dict[str, dict[str, Any]] = {
    "constant": {"setpoint": 70.0},
    "paper, uniform": {"setpoint": 20.0, "dynamics": "paper", "start": "uniform"},
    "drifting": {"setpoint": {"drifting": 50.0}},
    "drifting, burn-in": {
        "setpoint": {"drifting": 95.0},
        "start": {"burn_in": [3, 40]},
        "dynamics": {"base": "paper", "eta_mean": 0.1},
    },
}


@pytest.fixture(params=EPISODES, scope="session")
def case(request: pytest.FixtureRequest) -> dict[str, Any]:
    """Settings of an environment and of a dataset alike."""
    return EPISODES[request.param]


@pytest.fixture(scope="session")
def recorded(case: dict[str, Any]) -> Any:
    """A dataset's episode under these settings; see `recorded.py`."""
    return runpy.run_path(str(Path(__file__).with_name("recorded.py")))["recorded_episode"](**case)
