"""Fixtures for commands that meet a fault: the compiled shim, and a process that runs them in forks."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

HERE = Path(__file__).resolve().parent


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
        exchange: bool = True,
        meanwhile: Callable[[], object] = lambda: None,
    ) -> Answer:
        """One run; folder is where operations are counted, log the file of those that were done.

        `meanwhile` is called where the run stops (mode SIGSTOP); it may run other commands.
        """
        request: dict[str, Any] = {"args": [str(arg) for arg in args], "folder": str(folder), "at": at}
        request |= {"mode": mode, "log": str(log), "user": user, "exchange": exchange}
        answer = self._ask(request)
        while answer == "stopped":
            try:
                meanwhile()
            finally:
                answer = self._ask(None)
        return Answer(**answer)

    def _ask(self, request: dict[str, Any] | None) -> Any:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())


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
def forks(shim: str) -> Iterator[Forks]:
    """A process that has everything loaded."""
    with subprocess.Popen(
        [sys.executable, str(HERE / "fork_server.py")],
        env={**os.environ, "LD_PRELOAD": shim},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        forks = Forks(process)
        assert forks.run("--version").code == 0  # it has loaded everything
        yield forks
