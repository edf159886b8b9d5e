"""Fixtures for all tests: the installed command and files of datasets."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sysconfig
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from helpers import FULL

from ibdata.dataset import manifest
from ibdata.generation.metadata import as_json

# Background jobs of a shell ignore SIGINT, and those under nohup SIGHUP. Children would inherit this, but a
# signal that has a handler here gets its default action in them.
signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP"):
    signal.signal(signal.SIGHUP, lambda number, frame: None)

if not FULL:
    os.fsync = lambda descriptor: None  # 30 waits for the disk in each run; those of children stay

pytest_plugins = ["helpers.datasets", "helpers.forks", "helpers.own_code", "helpers.pages"]

Run = Callable[..., subprocess.CompletedProcess[str]]
ShardFile = Callable[[str | Path, int], str]


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """Windows imports only what is marked to run on every system: others need POSIX's names."""
    if os.name != "nt":
        return None
    tests = collection_path.rglob("test_*.py") if collection_path.is_dir() else [collection_path]
    return None if any(b"mark.portable" in test.read_bytes() for test in tests) else True


def pytest_make_parametrize_id(val: object) -> str | None:
    """Parameters are named by the beginning of their text."""
    return ascii(str(val))[1:-1][:30] if isinstance(val, str | dict | list | tuple) else None


@pytest.fixture(scope="session")
def command() -> str:
    """The path of the installed console script."""
    return str(Path(sysconfig.get_path("scripts"), "ibdata.exe" if os.name == "nt" else "ibdata"))


@pytest.fixture
def ibdata(command: str, tmp_path: Path) -> Run:
    """A function that runs `ibdata …` in an empty folder; stderr is without the announcement of compiling."""

    def run(
        *args: str, cwd: Path = tmp_path, env: dict[str, str] | None = None
    ) -> subprocess.CompletedProcess[str]:
        done = subprocess.run([command, *args], cwd=cwd, env=env, capture_output=True, text=True, timeout=300)
        done.stderr = re.sub(
            r"^ibdata: (compiling |.* in plain Python).*\n", "", done.stderr, flags=re.MULTILINE
        )
        return done

    return run


@pytest.fixture(scope="session")
def shard_file() -> ShardFile:
    """A function for the path of a shard in a folder, whose name ends with random digits, by its number."""

    def path(folder: str | Path, number: int) -> str:
        (found,) = Path(folder, "data").glob(f"part-{number:05d}-*.parquet")
        return f"data/{found.name}"

    return path


@pytest.fixture(scope="session")
def files() -> Callable[[str | Path], dict[str, bytes]]:
    """A function for the content of all files below a folder, which is equal for two runs of one experiment.

    The random digits in the names of shards are left out everywhere, and so are the parts of the manifest
    that depend on them: its checksum, and the hashes of the other files, whose content is compared anyway.
    """
    token = re.compile(rb"(part-[0-9]{5})-[0-9a-f]{16}(?=\.parquet)")

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


SIZES = {  # of what is worked on at a time
    "lanes": "ibdata.plan.rollout.LANES",
    "part_rows": "ibdata.plan.rollout.PART_ROWS",
    "lane_steps": "ibdata._simulation.unroll.BLOCK",
    "row_group_rows": "ibdata.generation.shard.ROW_GROUP_ROWS",
    "checked_rows": "ibdata.tools.checks.PIECE_ROWS",
    "sampled_rows": "ibdata.dataset.statistics.SAMPLE_ROWS",
    "compared_rows": "ibdata.evaluation.overlap.PART_ROWS",
    "counted_rows": "ibdata.dataset.quality.BLOCK_ROWS",
    "exported_rows": "ibdata.exporters._source.BLOCK_ROWS",
}


@pytest.fixture
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """A function that makes small what is worked on at a time; see SIZES."""

    def shrink(**sizes: int) -> None:
        for name, size in sizes.items():
            monkeypatch.setattr(SIZES[name], size)

    return shrink


@pytest.fixture
def url(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The URL of a folder `there` that is not there yet, in an empty current folder."""
    monkeypatch.chdir(tmp_path)
    return f"{tmp_path.as_uri()}/there"


@pytest.fixture
def global_generator() -> Iterator[None]:
    """NumPy's global generator, which the published package seeds, is left as it was."""
    before = np.random.get_state()  # noqa: NPY002
    yield
    np.random.set_state(before)  # noqa: NPY002
