"""F1 and F3: SIGKILL of the run, and of its workers, at random moments."""

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
    """What was seen of shards while a writer was killed and begun again."""

    kills: int
    sightings: int
    torn: list[str]
    finished: int


def kill_until(
    tools: Any,
    whole: dict[str, str],
    begin: Callable[[int], Any],
    end: Callable[[Path], None],
    kills: int,
    latest: float,
) -> Seen:
    """Begin runs and kill them at random moments until there were so many kills and the last run is done.

    begin(n) is the n-th run as its folder and process; end(folder) takes a finished one.
    """
    killed = sightings = finished = run = 0
    over = False
    torn: list[str] = []
    while killed < kills or (run and not over):
        folder, process = begin(run)
        deadline = time.monotonic() + (tools.random.uniform(0.3, latest) if killed < kills else 300)
        with process:
            while process.poll() is None and time.monotonic() < deadline:
                torn += tools.torn(folder, whole)
                sightings += len(tools.hashes(folder))
                time.sleep(0.02)
            over = process.poll() is not None
            if over:
                assert process.returncode == 0, process.stderr.read()
            else:
                killed += 1
                process.kill()
        torn += tools.torn(folder, whole)
        sightings += len(tools.hashes(folder))
        run += 1
        if over:
            finished += 1
            end(folder)
    return Seen(killed, sightings, torn, finished)


def test_a_run_killed_at_random_moments_shows_no_torn_shard_and_ends_with_the_undisturbed_dataset(
    tools: Any, whole: Whole
) -> None:
    root, shards = whole
    made: list[Path] = []
    finished: list[Path] = []

    def begin(run: int) -> tuple[Path, subprocess.Popen[str]]:
        if len(made) == len(finished):
            made.append(tools.where / f"out-{run}")
        return made[-1], tools.start(tools.many, made[-1], "--resume", "--workers", 1 + run % 3)

    def end(folder: Path) -> None:
        assert tools.root(folder) == root
        assert tools.hashes(folder) == shards
        assert tools.leftovers(folder) == []
        finished.append(folder)

    seen = kill_until(tools, shards, begin, end, tools.size(20, 200), 3.5)
    tools.figure(
        f"F1: {seen.kills} kills, {seen.sightings} shard sightings, {len(seen.torn)} torn, "
        f"{seen.finished} of {len(made)} datasets finished with the undisturbed root"
    )
    assert seen.torn == []


def test_the_naive_writer_shows_torn_shards_under_the_same_kills(tools: Any, whole: Whole) -> None:
    _, shards = whole
    corrupt, runs = [], [tools.where / "naive-0"]

    def begin(run: int) -> tuple[Path, subprocess.Popen[str]]:
        if (runs[-1] / "manifest.json").exists():
            runs.append(tools.where / f"naive-{run}")
        args = [sys.executable, str(NAIVE), str(tools.many), str(runs[-1])]
        return runs[-1], subprocess.Popen(args, stderr=subprocess.PIPE, text=True)

    def end(folder: Path) -> None:
        corrupt.extend(tools.torn(folder, shards))

    seen = kill_until(tools, shards, begin, end, tools.size(8, 200), 1.6)
    tools.figure(
        f"F1, control: the naive writer: {seen.kills} kills, {seen.sightings} shard sightings, "
        f"{len(seen.torn)} torn, {len(corrupt)} corrupt shards in {seen.finished} finished datasets"
    )
    assert seen.torn


def wait_for(condition: Callable[[], Any], process: subprocess.Popen[str], seconds: float = 20) -> Any:
    """What the condition gives, once it holds; None if the process ended first."""
    deadline = time.monotonic() + seconds
    while process.poll() is None and time.monotonic() < deadline:
        if found := condition():
            return found
        time.sleep(0.005)
    return None


def test_a_run_whose_worker_is_killed_ends_with_the_same_dataset_or_says_so_within_five_seconds(
    tools: Any, whole: Whole
) -> None:
    same = refused = 0
    for i in range(tools.size(5, 50)):
        out = tools.where / f"out-{i}"
        with tools.start(tools.many, out, "--workers", 3) as process:
            workers = wait_for(lambda run=process: tools.workers(run.pid), process)
            assert workers, "no worker was seen"
            time.sleep(tools.random.uniform(0, 1.5))
            workers = tools.workers(process.pid) or workers
            if process.poll() is None:
                tools.kill(tools.random.choice(workers), signal.SIGKILL)
            start = time.monotonic()
            _, stderr = process.communicate(timeout=60)
        if process.returncode == 0:
            assert tools.root(out) == whole[0]
            assert tools.leftovers(out) == []
            same += 1
        else:
            assert time.monotonic() - start < 5
            assert process.returncode == 1
            assert tools.one_line(stderr), stderr
            refused += 1
    tools.figure(f"F3: a worker killed in {same + refused} runs: {same} same root, {refused} refused")


def test_a_run_whose_workers_are_all_killed_again_and_again_ends_with_one_line(
    tools: Any, whole: Whole
) -> None:
    out = tools.where / "out"
    with tools.start(tools.many, out, "--workers", 2) as process:
        killed, deadline, last = set(), time.monotonic() + 60, time.monotonic()
        while process.poll() is None and time.monotonic() < deadline:
            for worker in set(tools.workers(process.pid)) - killed:
                tools.kill(worker, signal.SIGKILL)
                killed.add(worker)
                last = time.monotonic()
            time.sleep(0.02)
        _, stderr = process.communicate(timeout=10)
    seconds = time.monotonic() - last
    tools.figure(f"F3, every worker: {len(killed)} killed, exit {seconds:.1f} s after the last")
    assert process.returncode == 1
    assert tools.one_line(stderr), stderr
    assert seconds < 5
    assert [name for name in tools.leftovers(out) if ".tmp-" in name or ".lock" in name] == []
    assert tools.generate(tools.many, out, "--resume").returncode == 0
    assert tools.root(out) == whole[0]
