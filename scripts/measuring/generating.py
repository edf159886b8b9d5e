"""Measure the time to generate a dataset, compared with other programs and by the size of the dataset."""

import importlib.util
import json
import os
import shutil
import statistics
import subprocess
from collections.abc import Callable

import pyarrow.parquet as pq

from ibdata import Experiment
from ibdata.experiment.plan import plan
from ibdata.simulation.rollout import rollout
from ibdata.simulation.variables import columns
from ibdata.writing.arrow import ROW_GROUP_ROWS, arrow_schema, arrow_table, writer_options
from measuring.timing import COMMAND, MILLION, Row, Scratch, described, paired, processor_time

EPSILON = {"kind": "epsilon_greedy", "base": {"kind": "optimized"}, "epsilon": 0.4}
PUBLISHED = """
import sys, time
import numpy as np
np.float = float
from industrial_benchmark_python.IDS import IDS
recording, steps = sys.argv[1] == "record", int(sys.argv[2])
rows, start = [], time.perf_counter()
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
print((time.perf_counter() - start) / (10 * steps))
"""
GYMNASIUM = """
import time
import gymnasium
env = gymnasium.make("ibdata.environment:ibdata/IndustrialBenchmark-v0", setpoint=70)
env.action_space.seed(0); env.reset(seed=0)
rows, o = [], env.reset(seed=0)[0]
start = time.perf_counter()
for t in range(10_000):
    a = env.action_space.sample()
    after, r, terminated, truncated, info = env.step(a)
    rows.append((o, a, after, r, info)); o = after
    if truncated: o = env.reset()[0]
print((time.perf_counter() - start) / 10_000)
"""


def floor(experiment: Experiment, scratch: Scratch) -> Callable[[], None]:
    """A function in which pyarrow alone writes the same table with the same options to one file."""
    (shard,) = plan(experiment)
    table = arrow_table(experiment, shard, rollout(experiment, shard.first, shard.stop))
    kinds = columns(experiment)

    def write() -> None:
        path = scratch.folder / "floor.parquet"
        with pq.ParquetWriter(path, arrow_schema(kinds), **writer_options(kinds)) as writer:
            writer.write_table(table, row_group_size=ROW_GROUP_ROWS)

    return write


def end_to_end(scratch: Scratch) -> list[Row]:
    """Runs compared with pyarrow alone, with the published package and with a plain loop."""
    rows: list[Row] = []
    for name, experiment, target in (
        ("random", described(MILLION), 1.8),
        ("ε-greedy optimized", described(MILLION, EPSILON), 2.3),
    ):
        rows += against_the_floor(scratch, name, experiment, target)
    return [*rows, *against_loops(scratch), two_workers(scratch)]


def against_the_floor(scratch: Scratch, name: str, experiment: Experiment, target: float) -> list[Row]:
    """Runs into several files and into one, compared with pyarrow alone."""
    larger = experiment.model_copy(update={"episodes": 4 * experiment.episodes})
    small, several, least = paired(
        lambda: scratch.generate(experiment), lambda: scratch.generate(larger), floor(experiment, scratch)
    )
    return [
        (
            f"1 worker, {name}, {size}, against the floor",
            f"{ours / least:.2f} ×",
            wanted,
            f"{1e9 * ours / MILLION:.0f} ns a transition; pyarrow alone {1e9 * least / MILLION:.0f}",
        )
        for ours, size, wanted in (
            (several / 4, "4 million in 4 files", f"≤ {target} ×"),
            (small, "1 million in 1 file", ""),
        )
    ]


def against_loops(scratch: Scratch) -> list[Row]:
    """A run compared with loops that call a simulator for each transition: the published one and ours."""
    larger = described(4 * MILLION)
    (one,) = paired(lambda: scratch.generate(larger))
    core = processor_time(lambda: scratch.generate(larger)) / 4
    recorded, stepped = (
        statistics.median(scratch.script(PUBLISHED, kind, "1000") for _ in range(3))
        for kind in ("record", "step")
    )
    rows: list[Row] = [
        (
            "per core, against the published package recording",
            f"{recorded * MILLION / core:.0f} ×",
            "≥ 90 ×",
            f"{1e9 * core / MILLION:.0f} ns of processor time; the package takes {recorded * 1e6:.1f} µs, "
            f"stepping alone {stepped * 1e6:.1f}",
        ),
        (
            "one worker with its threads, against the published package recording",
            f"{recorded * MILLION / (one / 4):.0f} ×",
            "",
            "",
        ),
    ]
    if importlib.util.find_spec("gymnasium"):
        loop = statistics.median(scratch.script(GYMNASIUM) for _ in range(3))
        rows.append(
            (
                "per core, against a loop over our environment",
                f"{loop * MILLION / core:.0f} ×",
                "",
                f"{loop * 1e6:.1f} µs a transition",
            )
        )
    return rows


def two_workers(scratch: Scratch) -> Row:
    """Two workers compared with one."""
    experiment = described(4 * MILLION)
    single, double = paired(
        lambda: scratch.generate(experiment, 1), lambda: scratch.generate(experiment, 2), times=3
    )
    return (
        "two workers against one, 4 million",
        f"{single / double:.2f} ×",
        "≥ 1.8 ×",
        f"{os.cpu_count()} cores",
    )


def start_up(scratch: Scratch) -> list[Row]:
    """The start-up of the command, and the paper's protocol compared with the published package."""
    help_seconds, ten, paper, theirs = paired(
        lambda: subprocess.run([COMMAND, "--help"], check=True, capture_output=True),
        lambda: _command(scratch, "--set", "steps=1"),
        lambda: _command(scratch),
        lambda: scratch.script(PUBLISHED, "record", "1000"),
    )
    return [
        ("ibdata --help", f"{help_seconds:.2f} s", "≤ 0.3 s", ""),
        ("ibdata generate, 10 rows", f"{ten:.2f} s", "", "imports and loading machine code"),
        (
            "the paper's 10,000 rows, against the published package",
            f"{paper / theirs:.2f} ×",
            "≤ 1 ×",
            f"{paper:.2f} s and {theirs:.2f} s, start-up included",
        ),
    ]


def _command(scratch: Scratch, *arguments: str) -> None:
    shutil.rmtree(scratch.folder / "command", ignore_errors=True)
    out = str(scratch.folder / "command")
    subprocess.run(
        [COMMAND, "generate", "--config", "random", "--out", out, "--workers", "1", *arguments],
        check=True,
        capture_output=True,
    )


def scaling(scratch: Scratch, full: bool) -> tuple[list[Row], list[tuple[int, float, float]]]:
    """Time and peak memory of one worker, by the number of transitions."""
    points = []
    for rows in (10_000, 100_000, MILLION, 10 * MILLION, *([100 * MILLION] if full else [])):
        points.append((rows, *scratch.child(described(rows))))
        shutil.rmtree(scratch.folder / "child")
    memory = {rows: used for rows, _, used in points}
    largest = max(memory)
    listed = [
        (f"{rows:,} transitions, one worker", f"{1e9 * s / rows:.0f} ns each", "", f"peak {used:.0f} MB")
        for rows, s, used in points
    ]
    ratio = memory[largest] / memory[MILLION]
    return [
        *listed,
        (f"peak memory, {largest:,} against 1,000,000", f"{ratio:.2f} ×", "≤ 1.1 ×", ""),
        ("peak memory of a worker", f"{max(memory.values()):.0f} MB", "≤ 600 MB", ""),
    ], points


def sizes(scratch: Scratch) -> list[Row]:
    """Bytes per row for each kind of latent state."""
    targets = {True: "≤ 85", "full": "≤ 108"}
    found: list[Row] = []
    for latent in (False, True, "full", "next"):
        experiment = described(100_000, output={"latent": latent})
        size = scratch.generate(experiment).info["counts"]["data_bytes"] / 100_000
        name = json.dumps(latent).strip('"')
        found.append((f"bytes a row, latent: {name}", f"{size:.1f}", targets.get(latent, ""), ""))
    return found
