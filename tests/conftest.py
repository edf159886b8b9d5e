"""What all tests share: the installed command, run as a user would."""

from __future__ import annotations

import hashlib
import json
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.recorded import recorded_episode

from ibdata.dataset import manifest
from ibdata.writing.metadata import as_json

# Background jobs of a shell ignore SIGINT, those under nohup SIGHUP, and children would inherit that; what is
# handled here is at its default in them.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, lambda number, frame: None)

pytest_plugins = ["helpers.datasets", "helpers.use_with"]

Run = Callable[..., subprocess.CompletedProcess[str]]
ShardFile = Callable[[str | Path, int], str]


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


@pytest.fixture(scope="session")
def shard_file() -> ShardFile:
    """The path of a shard of that number inside a folder: its name ends with a token."""

    def path(folder: str | Path, number: int) -> str:
        (found,) = Path(folder, "data").glob(f"part-{number:05d}-????????.parquet")
        return f"data/{found.name}"

    return path


@pytest.fixture(scope="session")
def files() -> Callable[[str | Path], dict[str, bytes]]:
    """What is in the files below a folder; two runs of one experiment have the same.

    The digits that end a shard's name are left out wherever they are, and so is what of the manifest follows
    from them: its checksum, and the hashes of the other files, which are compared themselves.
    """
    token = re.compile(rb"(part-[0-9]{5})-[0-9a-f]{8}(?=\.parquet)")

    def content(path: Path) -> bytes:
        data = path.read_bytes()
        if path.name == Path(manifest.PATH).name:
            listed = json.loads(data)
            listed["files"] = [file if "data/" in file["path"] else file["path"] for file in listed["files"]]
            data = as_json({**listed, "checksum": None})
        return data if path.suffix == ".parquet" else token.sub(rb"\1", data)

    def below(folder: str | Path) -> dict[str, bytes]:
        paths = (path for path in Path(folder).rglob("*") if path.is_file())
        return {token.sub(rb"\1", bytes(path.relative_to(folder))).decode(): content(path) for path in paths}

    return below


@pytest.fixture(scope="session")
def sign() -> Callable[[Path, str], None]:
    """Give a manifest the hash of a file that was changed, and its checksum, as who means harm would."""

    def signed(folder: Path, path: str) -> None:
        listed = json.loads((folder / manifest.PATH).read_bytes())
        data = (folder / path).read_bytes()
        for file in listed["files"]:
            if file["path"] == path:
                file |= {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
        listed["checksum"] = manifest.checksum(listed)
        (folder / manifest.PATH).write_bytes(as_json(listed))

    return signed


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
    """A dataset's episode under these settings; see `helpers/recorded.py`."""
    return recorded_episode(**case)
