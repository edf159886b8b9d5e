"""F6: two runs in one folder."""

import os
import signal
import time
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.faults
BUSY = 75


def wait_for_lock(out: Path, process: Any) -> None:
    """Until the first run holds the folder."""
    deadline = time.monotonic() + 20
    while not (out / ".lock").exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.005)
    assert process.poll() is None


def test_the_second_writer_leaves_within_a_second_and_the_first_is_not_disturbed(
    forks: Any, tools: Any, whole: Any
) -> None:
    loaded, started = [], []
    others = [("--resume",), ("--seed", 7), ("--overwrite", "--seed", 7), ("--dry-run",)]
    races = tools.size(5, 50)
    for i in range(races):
        out = tools.where / f"out-{i}"
        with tools.start(tools.many, out, "--workers", 2) as first:
            wait_for_lock(out, first)
            time.sleep(tools.random.uniform(0, 0.8))
            more = others[i % len(others)]
            start = time.monotonic()
            second = forks.run("generate", "--config", tools.many, "--out", out, *more)
            loaded.append(time.monotonic() - start)
            assert second.code == BUSY, second
            assert tools.one_line(second.output), second.output
            if first.poll() is None and (i == 0 or tools.full):
                start = time.monotonic()
                third = tools.generate(tools.many, out, *more)
                if first.poll() is None:
                    started.append(time.monotonic() - start)
                    assert third.returncode == BUSY, third
                    assert tools.one_line(third.stderr), third.stderr
            _, stderr = first.communicate(timeout=60)
        assert first.returncode == 0, stderr
        assert tools.root(out) == whole[0]
        assert tools.leftovers(out) == []
    tools.figure(
        f"F6: {races} second writers out with 75 after {max(loaded):.2f} s at most without Python's start, "
        f"{max(started, default=0.0):.2f} s with it; {races} first ones with the undisturbed root"
    )
    assert max(loaded) < 1


def test_of_runs_that_start_together_one_makes_the_dataset_and_the_others_are_refused(
    tools: Any, whole: Any
) -> None:
    races = tools.size(2, 50)
    for i in range(races):
        out = tools.where / f"out-{i}"
        seeds = ("0", "0", "7") if i % 2 else ("0", "0", "0")
        runs = [tools.start(tools.many, out, "--workers", 1, "--seed", seed) for seed in seeds]
        said = [run.communicate(timeout=100)[1] for run in runs]
        codes = sorted(run.returncode for run in runs)
        assert codes[0] == 0, said
        assert set(codes[1:]) <= {2, BUSY}, said
        assert all(text == "" or tools.one_line(text) for text in said), said
        assert tools.root(out) == whole[0] or runs[-1].returncode == 0
        assert tools.leftovers(out) == []
    tools.figure(
        f"F6, together: {races} races of 3 runs: one made the dataset, the others ended with 75 or 2"
    )


def test_the_lock_of_a_killed_run_does_not_block(tools: Any, whole: Any) -> None:
    out = tools.where / "out"
    with tools.start(tools.many, out, "--workers", 2) as first:
        wait_for_lock(out, first)
        first.send_signal(signal.SIGKILL)
        first.communicate()
    assert (out / ".lock").exists()
    assert tools.generate(tools.many, out, "--resume").returncode == 0
    assert tools.root(out) == whole[0]


def test_a_lock_that_somebody_removed_lets_no_run_finish_a_mixed_dataset(tools: Any, whole: Any) -> None:
    out = tools.where / "out"
    with tools.start(tools.many, out, "--workers", 2) as first:
        wait_for_lock(out, first)
        os.unlink(out / ".lock")
        second = tools.generate(tools.many, out, "--resume", "--workers", 2)
        _, stderr = first.communicate(timeout=60)
    assert all(text == "" or tools.one_line(text) for text in (stderr, second.stderr)), (stderr, second)
    assert tools.generate(tools.many, out, "--resume").returncode == 0
    assert tools.root(out) == whole[0]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_run_whose_folder_was_moved_away_does_not_touch_the_next_run_at_that_place(
    tools: Any, ending: Any, workers: int
) -> None:
    from ibdata.validation.validate import validate

    out, gone, fresh = (tools.where / name for name in ("out", "gone", "fresh"))
    assert tools.generate(tools.many, fresh, "--seed", 7).returncode == 0
    with tools.start(tools.many, out, "--workers", workers) as first:
        ending(first)
        wait_for_lock(out, first)
        deadline = time.monotonic() + 20
        while not tools.hashes(out) and time.monotonic() < deadline:
            time.sleep(0.005)
        out.rename(gone)
        with tools.start(tools.many, out, "--seed", 7, "--workers", 2) as second:
            ending(second)
            _, stderr = first.communicate(timeout=60)
            _, said = second.communicate(timeout=60)
    assert first.returncode == 1, stderr
    assert tools.one_line(stderr), stderr
    assert second.returncode == 0, said
    assert validate(out) == []
    assert tools.hashes(out) == tools.hashes(fresh)
    assert tools.leftovers(out) == []
    assert tools.generate(tools.many, gone, "--resume").returncode == 0
    assert validate(gone) == []
