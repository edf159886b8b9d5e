"""Fixtures for fault tests: experiments with many shards, runs, checks after them, the shim."""

import contextlib
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import pytest

HERE = Path(__file__).resolve().parent
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


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """The figures of the tests, a line each."""
    reports = [*terminalreporter.getreports("passed"), *terminalreporter.getreports("failed")]
    figures = [value for report in reports for name, value in report.user_properties if name == "figure"]
    if figures:
        terminalreporter.section("faults")
        for figure in sorted(set(figures)):
            terminalreporter.write_line(figure)


def by_pyarrow(folder: Path) -> list[float]:
    """Through a list of files that is made first and opened later."""
    import pyarrow.dataset

    rewards: list[float] = pyarrow.dataset.dataset(folder / "data").to_table(["reward"])["reward"].to_pylist()
    return rewards


def by_pandas(folder: Path) -> list[float]:
    """The folder."""
    import pandas as pd

    rewards: list[float] = pd.read_parquet(folder / "data", columns=["reward"])["reward"].tolist()
    return rewards


def by_polars(folder: Path) -> list[float]:
    """The folder."""
    import polars as pl

    rewards: list[float] = pl.scan_parquet(folder / "data").select("reward").collect()["reward"].to_list()
    return rewards


def by_duckdb(folder: Path) -> list[float]:
    """A pattern."""
    import duckdb

    with duckdb.connect() as connection:
        rows = connection.sql(f"select reward from '{folder}/data/*.parquet'").fetchall()
    return [reward for (reward,) in rows]


def by_ibdata(folder: Path) -> list[float]:
    """The files that the manifest lists."""
    from ibdata.dataset.reader import Dataset

    rewards: list[float] = Dataset(folder).table(["reward"])["reward"].to_pylist()
    return rewards


READERS = {
    "pyarrow": by_pyarrow,
    "pandas": by_pandas,
    "polars": by_polars,
    "duckdb": by_duckdb,
    "ibdata": by_ibdata,
}


class Answer(NamedTuple):
    """What a run in a fork gave."""

    code: int
    output: str


class Forks:
    """`ibdata …` in forks of one loaded process, with a fault at the k-th operation."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process

    def run(
        self,
        *args: object,
        folder: Path | str = "/nowhere",
        at: int = 0,
        mode: str = "none",
        log: Path | str = "",
        user: int = 0,
        megabytes: int = 0,
        exchange: bool = True,
        readers: bool = False,
    ) -> Answer:
        """One run; folder is where operations are counted, log the file of those that were done.

        Where no readers look meanwhile, a replacement does not wait for them.
        """
        request = {"args": [str(arg) for arg in args], "folder": str(folder), "at": at, "mode": mode}
        request |= {"user": user, "megabytes": megabytes, "exchange": exchange, "readers": readers}
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps({**request, "log": str(log)}) + "\n")
        self._process.stdin.flush()
        return Answer(**json.loads(self._process.stdout.readline()))


class Tools:
    """Sizes, folders and checks."""

    def __init__(self, command: str, where: Path, properties: list[tuple[str, object]]) -> None:
        self.command, self.where, self._properties = command, where, properties
        self.full = os.environ.get("IBDATA_FAULTS") == "full"
        self.random = random.Random(20260101)

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
        """A command line of `generate`."""
        start = [self.command, "generate", "--quiet", "--config", config, "--out", out, *more]
        return [str(arg) for arg in start]

    def generate(
        self, config: Path, out: Path, *more: object, **options: Any
    ) -> subprocess.CompletedProcess[str]:
        """Run `ibdata generate` to its end."""
        args = self.args(config, out, *more)
        return subprocess.run(args, capture_output=True, text=True, timeout=120, **options)

    def start(self, config: Path, out: Path, *more: object, **options: Any) -> subprocess.Popen[str]:
        """Begin `ibdata generate`, its output in a pipe."""
        pipes: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
        return subprocess.Popen(self.args(config, out, *more), **{**pipes, **options})

    def root(self, folder: Path) -> str:
        """The content root of a dataset that is whole, after everything was checked."""
        from ibdata.dataset.reader import Dataset
        from ibdata.validation.validate import validate

        assert validate(folder) == []
        dataset = Dataset(folder)
        assert dataset.table().num_rows == len(dataset)
        return dataset.content_root

    def rewards(self, folder: Path) -> dict[str, list[float] | None]:
        """The rewards that each reader finds in a dataset, whatever its order; None where it finds none."""
        found: dict[str, list[float] | None] = {}
        for name, read in READERS.items():
            try:
                found[name] = sorted(read(folder))
            except Exception:  # each reader has errors of its own
                found[name] = None
            except BaseException as error:  # polars opens a file twice, and it may have shrunk
                if type(error).__name__ != "PanicException":
                    raise
                found[name] = None
        return found

    def leftovers(self, folder: Path) -> list[str]:
        """Files and folders of a run that should have gone; a replacement leaves one name in `.next`."""
        names = [".lock", ".run", ".next", ".new", ".fresh"]
        kept = [path.name for path in (folder / ".next").rglob("*") if not path.is_dir()]
        if kept == ["replaced"]:
            names.remove(".next")
        found = [path for path in folder.rglob("*") if path.name in names or path.name.startswith(".tmp-")]
        return sorted(str(path.relative_to(folder)) for path in found)

    def hashes(self, folder: Path) -> dict[str, str]:
        """SHA-256 of the visible shards, by name without its token."""
        shards: dict[str, str] = {}
        for path in sorted((folder / "data").glob("part-*.parquet")):
            try:
                shards[path.name.rpartition("-")[0]] = hashlib.sha256(path.read_bytes()).hexdigest()
            except FileNotFoundError:
                continue  # it was there when the folder was listed
        return shards

    def torn(self, folder: Path, whole: dict[str, str]) -> list[str]:
        """Visible shards that are not the final ones."""
        return [name for name, digest in self.hashes(folder).items() if digest != whole.get(name)]

    def one_line(self, text: str) -> bool:
        """Whether a message is one line for people."""
        lines = text.splitlines()
        return len(lines) == 1 and "Traceback" not in text and "a bug of ibdata" not in text

    def processes(self, mark: str) -> list[int]:
        """Running processes whose environment or command line has the mark: ours, and what they started."""
        found = []
        for entry in Path("/proc").iterdir():
            try:
                if (
                    not entry.name.isdigit()
                    or (entry / "stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
                ):
                    continue
                text = (entry / "environ").read_bytes() + (entry / "cmdline").read_bytes()
            except OSError:
                continue
            if mark.encode() in text and int(entry.name) != os.getpid():
                found.append(int(entry.name))
        return found

    def kill(self, process: int, number: int) -> None:
        """Send a signal to a process that may have ended."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(process, number)

    def workers(self, parent: int) -> list[int]:
        """The spawned worker processes of a run."""
        found = []
        for task in Path(f"/proc/{parent}/task").glob("*"):
            try:
                children = (task / "children").read_text().split()
                found += [
                    int(c) for c in children if b"spawn_main" in Path(f"/proc/{c}/cmdline").read_bytes()
                ]
            except OSError:
                continue
        return sorted(found)


@pytest.fixture
def tools(command: str, tmp_path: Path, request: pytest.FixtureRequest) -> Tools:
    """Sizes, folders and checks; the seed of its random numbers is fixed."""
    return Tools(command, tmp_path, request.node.user_properties)


@pytest.fixture(scope="session")
def whole(command: str, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, dict[str, str]]:
    """Content root and hashes of the shards of `many`, of a run that nothing disturbed."""
    tools = Tools(command, tmp_path_factory.mktemp("whole"), [])
    made = tools.generate(tools.many, tools.where / "out")
    assert made.returncode == 0, made.stderr
    return tools.root(tools.where / "out"), tools.hashes(tools.where / "out")


@pytest.fixture(scope="session")
def shim(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The compiled shim."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler")
    path = tmp_path_factory.mktemp("shim") / "shim.so"
    subprocess.run([compiler, "-O2", "-shared", "-fPIC", "-o", path, HERE / "shim.c"], check=True)
    return str(path)


@pytest.fixture(scope="session")
def forks(shim: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Forks]:
    """A process that has everything loaded."""
    config = tmp_path_factory.mktemp("forks") / "tiny.yaml"
    config.write_text(TINY, encoding="utf-8")
    with subprocess.Popen(
        [sys.executable, str(HERE / "forks.py"), str(config)],
        env={**os.environ, "LD_PRELOAD": shim},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        yield Forks(process)


@pytest.fixture
def ending() -> Iterator[Callable[[subprocess.Popen[str]], None]]:
    """Processes that are ended with the test, whatever happens."""
    started: list[subprocess.Popen[str]] = []
    yield started.append
    for process in started:
        if process.poll() is None:
            process.send_signal(signal.SIGKILL)
        process.communicate()
