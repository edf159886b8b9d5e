"""Measure the time to generate a dataset, compared with other programs and by the size of the dataset."""

import importlib.util
import json
import os
import shutil
import statistics
import subprocess
from functools import partial

from measuring.timing import COMMAND, MILLION, TIMES, Row, Scratch, described, paired

PUBLISHED = """
import sys, time
import numpy as np
np.float = float
from industrial_benchmark_python.IDS import IDS
recording, steps = sys.argv[1] == "record", int(sys.argv[2])
rows, start = [], time.process_time()
for p in range(10, 101, 10):
    env = IDS(p=p, inital_seed=p)
    o, m = env.visibleState(), env.markovState()
    for t in range(steps):
        a = 2 * np.random.rand(3) - 1
        env.step(a)
        if recording:
            after, now = env.visibleState(), env.markovState()
            rows.append((o, a, after, after[-1], m))
            o, m = after, now
print((time.process_time() - start) / (10 * steps))
"""
GYMNASIUM = """
import time
import gymnasium
env = gymnasium.make("ibdata.environment:ibdata/IndustrialBenchmark-v0", setpoint=70)
env.action_space.seed(0); env.reset(seed=0)
rows, o = [], env.reset(seed=0)[0]
start = time.process_time()
for t in range(10_000):
    a = env.action_space.sample()
    after, r, terminated, truncated, info = env.step(a)
    rows.append((o, a, after, r, info)); o = after
    if truncated: o = env.reset()[0]
print((time.process_time() - start) / 10_000)
"""


def speed(scratch: Scratch) -> list[Row]:
    """One processor compared with loops that call a simulator for each transition; then all processors."""
    one = pinned(scratch, MILLION)
    kinds = ("record", "step")
    recorded, stepped = (median_of_three(scratch, PUBLISHED, kind, "1000") for kind in kinds)
    remark = f"{1e9 * one:.0f} ns of processor time a transition; the package takes {recorded * 1e6:.1f} µs, "
    remark += f"stepping alone {stepped * 1e6:.1f}"
    what = "one processor, 1,000,000 transitions, against the published package recording"
    rows: list[Row] = [(what, f"{recorded / one:.0f} ×", "≥ 125 ×", remark)]
    if importlib.util.find_spec("gymnasium"):
        loop = median_of_three(scratch, GYMNASIUM)
        what, remark = (
            "one processor, against a loop over our environment",
            f"{loop * 1e6:.1f} µs a transition",
        )
        rows.append((what, f"{loop / one:.0f} ×", "", remark))
    return [*rows, *all_processors(scratch), files(scratch)]


def median_of_three(scratch: Scratch, *script: str) -> float:
    """The median of what a script prints in three runs."""
    return statistics.median(scratch.script(*script) for _ in range(3))


def pinned(scratch: Scratch, rows: int) -> float:
    """Seconds of processor time a transition in a process that may use one processor."""
    found = [scratch.child(described(rows), processors=1).processor for _ in range(TIMES)]
    return statistics.median(found) / rows


def all_processors(scratch: Scratch) -> list[Row]:
    """The default number of workers compared with each other number and with one processor."""
    rows: list[Row] = []
    for size in (10_000, 100_000, MILLION, 4 * MILLION, 10 * MILLION):
        numbers = (None, *range(1, (os.cpu_count() or 1) + 1))
        calls = [partial(scratch.generate, described(size), workers) for workers in numbers]
        default, *others = paired(*calls, times=3)
        each = ", ".join(f"{workers}: {seconds:.2f} s" for workers, seconds in enumerate(others, start=1))
        what = f"default workers against the best number, {size:,} transitions"
        rows.append((what, f"{default / min(others):.2f} ×", "≤ 1.1 ×", f"{default:.2f} s; workers {each}"))
    alone = scratch.child(described(10 * MILLION), processors=1).seconds
    what, remark = "all processors against one, 10,000,000 transitions", f"{os.cpu_count()} processors"
    return [*rows, (what, f"{alone / default:.2f} ×", "≥ 1.5 ×", remark)]


def files(scratch: Scratch) -> Row:
    """One file compared with four."""
    one, four = paired(*(partial(scratch.generate, described(n * MILLION)) for n in (1, 4)))
    what = "seconds a transition, 1,000,000 in one file against 4,000,000 in four"
    remark = f"{1e9 * one / MILLION:.0f} and {1e9 * four / (4 * MILLION):.0f} ns"
    return what, f"{4 * one / four:.2f} ×", "≤ 1.2 ×", remark


def start_up(scratch: Scratch) -> list[Row]:
    """The start-up of the command, and the paper's protocol compared with the published package."""
    help_seconds, ten, paper, theirs = paired(
        lambda: subprocess.run([COMMAND, "--help"], check=True, capture_output=True),
        lambda: _command(scratch, "--set", "steps=1"),
        lambda: _command(scratch),
        lambda: scratch.script(PUBLISHED, "record", "1000"),
    )
    what, remark = "the paper's 10,000 rows, against the published package", "start-up included"
    return [
        ("ibdata --help", f"{help_seconds:.2f} s", "≤ 0.3 s", ""),
        ("ibdata generate, 10 rows", f"{ten:.2f} s", "", "imports and loading machine code"),
        (what, f"{paper / theirs:.2f} ×", "≤ 0.7 ×", f"{paper:.2f} s and {theirs:.2f} s, {remark}"),
    ]


def _command(scratch: Scratch, *arguments: str) -> None:
    out = scratch.folder / "command"
    shutil.rmtree(out, ignore_errors=True)
    command = [str(COMMAND), "generate", "--config", "random", "--out", str(out), *arguments]
    subprocess.run(command, check=True, capture_output=True)


def scaling(scratch: Scratch, full: bool) -> tuple[list[Row], list[tuple[int, float, float]]]:
    """Time and peak memory, by the number of transitions."""
    points = []
    for rows in (10_000, 100_000, MILLION, 10 * MILLION, *([100 * MILLION] if full else [])):
        found = scratch.child(described(rows))
        points.append((rows, found.seconds, found.peak))
    listed = [
        (f"{rows:,} transitions", f"{1e9 * s / rows:.0f} ns each", "", f"peak {used:.0f} MB")
        for rows, s, used in points
    ]
    memory = {rows: used for rows, _, used in points}
    largest = max(memory)
    ratio = memory[largest] / memory[MILLION]
    return [
        *listed,
        (f"peak memory, {largest:,} against 1,000,000", f"{ratio:.2f} ×", "≤ 1.1 ×", ""),
        ("peak memory", f"{max(memory.values()):.0f} MB", "≤ 600 MB", ""),
    ], points


def sizes(scratch: Scratch) -> list[Row]:
    """Bytes per row for each kind of latent state."""
    targets = {True: "≤ 81", "full": "≤ 105"}
    found: list[Row] = []
    for latent in (False, True, "full", "next"):
        experiment = described(100_000, output={"latent": latent})
        size = scratch.generate(experiment).manifest_model.data_bytes / 100_000
        name = json.dumps(latent).strip('"')
        found.append((f"bytes a row, latent: {name}", f"{size:.1f}", targets.get(latent, ""), ""))
    return found
