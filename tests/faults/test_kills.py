"""F1 and F3: SIGKILL of the run, and of its workers, at random moments."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest

pytestmark = pytest.mark.faults
Whole = tuple[str, dict[str, str]]
NAIVE = Path(__file__).resolve().with_name("naive.py")


class Seen(NamedTuple):
    """What was seen in the folders while writers were killed and begun again."""

    kills: int
    looks: int
    torn: list[str]  # shards that are there, and not as they should be
    finished: list[Path]


def kill_until(tools: Any, whole: dict[str, str], begin: Callable[[Path], Any], kills: int) -> Seen:
    """Begin runs and kill them at random moments until there were so many kills and the last run is done."""
    killed = looks = 0
    torn: list[str] = []
    finished: list[Path] = []
    over = True
    while killed < kills or not over:
        folder = tools.where / f"out-{len(finished)}"
        deadline = time.monotonic() + (tools.random.uniform(0.3, 3.0) if killed < kills else 300)
        with begin(folder) as process:
            while process.poll() is None and time.monotonic() < deadline:
                hashes = tools.hashes(folder)
                torn += [name for name in hashes if hashes[name] != whole.get(name)]
                looks += 1
                time.sleep(0.01)
            over = process.poll() is not None
            if over:
                assert process.returncode == 0, process.stderr.read()
                finished.append(folder)
            else:
                killed += 1
                process.kill()
    return Seen(killed, looks, torn, finished)


def test_kills_at_random_moments(tools: Any, whole: Whole) -> None:
    """A run that is killed and resumed shows no torn shard, and ends with the undisturbed dataset."""
    root, shards = whole
    seen = kill_until(
        tools, shards, lambda out: tools.start(tools.many, out, "--resume"), tools.size(15, 200)
    )
    for folder in seen.finished:
        assert tools.root(folder) == root
        assert tools.hashes(folder) == shards
        assert tools.leftovers(folder) == []
    tools.figure(f"F1: {seen.kills} kills, {seen.looks} looks, {len(seen.torn)} torn shards")
    assert seen.torn == []


def test_the_naive_writer_tears_under_these_kills(tools: Any, whole: Whole) -> None:
    """The control: the looks above would have found torn shards."""

    def begin(folder: Path) -> subprocess.Popen[str]:
        args = [sys.executable, str(NAIVE), str(tools.many), str(folder)]
        return subprocess.Popen(args, stderr=subprocess.PIPE, text=True)

    seen = kill_until(tools, whole[1], begin, tools.size(6, 100))
    tools.figure(f"F1, control: the naive writer: {seen.kills} kills, {len(seen.torn)} torn shards")
    assert seen.torn


def test_a_killed_worker_ends_the_run_with_advice(tools: Any, whole: Whole) -> None:
    """The run ends within five seconds and names --resume, which makes the same dataset."""
    tries = tools.size(3, 50)
    for i in range(tries):
        out = tools.where / f"out-{i}"
        with tools.start(tools.many, out, "--workers", 3) as process:
            workers = tools.wait_for(lambda run=process: tools.workers(run.pid), process)
            tools.wait_for(lambda out=out: tools.receipts(out) > 2, process)
            process.send_signal(signal.SIGSTOP)  # so that it does not end first
            os.kill(tools.random.choice(workers), signal.SIGKILL)
            process.send_signal(signal.SIGCONT)
            start = time.monotonic()
            _, stderr = process.communicate(timeout=60)
        assert time.monotonic() - start < 5
        assert process.returncode == 1
        assert tools.one_line(stderr), stderr
        assert "--resume" in stderr
        assert tools.generate(tools.many, out, "--resume").returncode == 0
        assert tools.root(out) == whole[0]
    tools.figure(f"F3: a worker killed in {tries} runs: each ended with one line and was resumed")
