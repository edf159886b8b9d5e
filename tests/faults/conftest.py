"""Fixtures for fault tests: experiments with many shards, runs, and checks after them."""

import contextlib
import os
import random
import subprocess
from functools import cached_property
from pathlib import Path
from typing import Any

import pytest
from helpers.folders import part_of
from helpers.readers import rewards

MANY = """\
name: many
setpoints: [10, 30, 50, 70, 90]
policies: [{kind: random}]
episodes: 40
steps: 50
output: {shard_rows: 100}
"""
TINY = """\
name: tiny
setpoints: [10, 50]
policies: [{kind: random}]
episodes: 2
steps: 10
output: {shard_rows: 20}
"""


def pytest_configure(config: pytest.Config) -> None:
    """Strict markers: the name is known here too."""
    config.addinivalue_line("markers", "faults: kills, full disks, bit flips; minutes long")


class Tools:
    """Sizes, folders and checks."""

    def __init__(self, command: str, where: Path, properties: list[tuple[str, object]]) -> None:
        self.command, self.where, self._properties = command, where, properties
        self.full = os.environ.get("IBDATA_FAULTS") == "full"
        self.random = random.Random(20260101)
        self.rewards = rewards

    def size(self, short: int, full: int) -> int:
        """How many cases: fewer in CI."""
        return full if self.full else short

    def figure(self, line: str) -> None:
        """Say a number at the end of the run."""
        self._properties.append(("figure", line))

    @cached_property
    def many(self) -> Path:
        """An experiment of 100 shards."""
        return self.file("many.yaml", MANY)

    @cached_property
    def tiny(self) -> Path:
        """An experiment of two shards of 20 rows."""
        return self.file("tiny.yaml", TINY)

    def file(self, name: str, text: str) -> Path:
        """A file beside the datasets."""
        path = self.where / name
        path.write_text(text, encoding="utf-8")
        return path

    def args(self, config: Path, out: Path, *more: object) -> list[str]:
        """The arguments of a quiet `ibdata generate` with one worker, unless `more` says otherwise."""
        return [str(arg) for arg in ("generate", "--quiet", config, "--out", out, "--workers", 1, *more)]

    def generate(
        self, config: Path, out: Path, *more: object, **options: Any
    ) -> subprocess.CompletedProcess[str]:
        """Run `ibdata generate` to its end."""
        args = [self.command, *self.args(config, out, *more)]
        return subprocess.run(args, capture_output=True, text=True, timeout=120, **options)

    def start(self, config: Path, out: Path, *more: object, **options: Any) -> subprocess.Popen[str]:
        """Begin `ibdata generate`, its output in a pipe."""
        pipes: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
        return subprocess.Popen([self.command, *self.args(config, out, *more)], **{**pipes, **options})

    def root(self, folder: Path) -> str:
        """The content root of a dataset that is whole, after everything was checked."""
        import ibdata

        assert ibdata.validate(folder) == []
        dataset = ibdata.open(folder)
        assert dataset.table().num_rows == len(dataset)
        return dataset.content_root

    def leftovers(self, folder: Path) -> list[str]:
        """What is there besides a finished dataset: the part beside it, hidden and temporary files in it."""
        found = [path for path in folder.rglob("*") if path.name.startswith(".") or "tmp" in path.name]
        return sorted(path.name for path in [*found, part_of(folder)] if os.path.lexists(path))

    def receipts(self, folder: Path) -> int:
        """How many shards of an unfinished run are finished."""
        return len(list(part_of(folder).glob("receipts/*")))

    def one_line(self, text: str) -> bool:
        """Whether a message is one line for people."""
        lines = text.splitlines()
        return len(lines) == 1 and "Traceback" not in text and "a bug of ibdata" not in text

    def processes(self, mark: str) -> list[int]:
        """Running processes whose environment or command line has the mark: ours, and what they started."""
        found = []
        for entry in Path("/proc").iterdir():
            with contextlib.suppress(OSError):
                if entry.name.isdigit() and (entry / "stat").read_text().rsplit(")", 1)[1].split()[0] != "Z":
                    text = (entry / "environ").read_bytes() + (entry / "cmdline").read_bytes()
                    found += [int(entry.name)] if mark.encode() in text else []
        return [number for number in found if number != os.getpid()]


@pytest.fixture
def tools(command: str, tmp_path: Path, request: pytest.FixtureRequest) -> Tools:
    """Sizes, folders and checks; the seed of its random numbers is fixed."""
    return Tools(command, tmp_path, request.node.user_properties)


@pytest.fixture(scope="session")
def whole(command: str, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The content root of `many`, of a run that nothing disturbed."""
    tools = Tools(command, tmp_path_factory.mktemp("whole"), [])
    made = tools.generate(tools.many, tools.where / "out")
    assert made.returncode == 0, made.stderr
    return tools.root(tools.where / "out")
