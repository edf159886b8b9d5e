"""Measure the time to generate a dataset, compared with other programs and by the size of the dataset."""

import json
import os
import resource
import statistics
import sys
from contextlib import closing
from functools import partial
from typing import Any

from ibdata.generation.process import Worker
from ibdata.plan.dataset_spec import DatasetSpec
from measuring.timing import COMMAND, MILLION, TIMES, Child, Row, Scratch, described, paired

PUBLISHED = """
import sys, time
import numpy as np
np.float = float
from industrial_benchmark_python.IDS import IDS
recording = sys.argv[1] == "record"
rows, start = [], time.process_time()
for p in range(10, 101, 10):
    env = IDS(p=p, inital_seed=p)
    o, m = env.visibleState(), env.markovState()
    for t in range(1000):
        a = 2 * np.random.rand(3) - 1
        env.step(a)
        if recording:
            after, now = env.visibleState(), env.markovState()
            rows.append((o, a, after, after[-1], m))
            o, m = after, now
print((time.process_time() - start) / 10_000)
"""

MODULES = """
import atexit, sys
from ibdata.cli import main
atexit.register(lambda: print(*(name for name in sys.modules if not name.startswith(("ibdata", "__m")))))
sys.argv = ["ibdata", "generate", "random", "--set", "steps=1", "--out", "ten", "--overwrite"]
main()
"""
IMPORTS = """
import os, sys
from contextlib import suppress
from importlib import import_module
for name in sys.argv[1:]:
    with suppress(ImportError):  # some are made by others, and no files
        import_module(name)
os._exit(0)
"""
POLICY = """
import numpy as np

class Still:
    def decide(self, observed):
        return np.zeros((len(observed.step), 3)), observed.memory
"""


def speed(scratch: Scratch) -> list[Row]:
    """One processor compared with loops that call a simulator for each transition; then all processors."""
    runs = [scratch.child(described(MILLION), processors=1).processor for _ in range(TIMES)]
    one = statistics.median(runs) / MILLION
    recorded, stepped = scratch.script(PUBLISHED, "record"), scratch.script(PUBLISHED, "step")
    remark = f"{1e9 * one:.0f} ns of processor time a transition; the package takes {recorded * 1e6:.1f} µs, "
    remark += f"stepping alone {stepped * 1e6:.1f}"
    what = "one processor, 1,000,000 transitions, against the published package recording"
    against_package = Row(what, f"{recorded / one:.0f} ×", "≥ 125 ×", remark)
    return [against_package, *all_processors(scratch), files(scratch)]


def all_processors(scratch: Scratch) -> list[Row]:
    """The default number of workers compared with each other number and with one processor."""
    rows = []
    for size in (10_000, MILLION, 10 * MILLION):
        numbers = (None, *range(1, (os.cpu_count() or 1) + 1))
        calls = [partial(scratch.generate, described(size), workers) for workers in numbers]
        default, *others = paired(*calls, times=3)
        each = ", ".join(f"{workers}: {seconds:.2f} s" for workers, seconds in enumerate(others, start=1))
        what = f"default workers against the best number, {size:,} transitions"
        ratio, remark = f"{default / min(others):.2f} ×", f"{default:.2f} s; workers {each}"
        rows.append(Row(what, ratio, "≤ 1.1 ×", remark))
    alone = scratch.child(described(10 * MILLION), processors=1).seconds
    what, remark = "all processors against one, 10,000,000 transitions", f"{os.cpu_count()} processors"
    return [*rows, Row(what, f"{alone / default:.2f} ×", "≥ 1.5 ×", remark)]


def files(scratch: Scratch) -> Row:
    """One file compared with four."""
    one, four = paired(*(partial(scratch.generate, described(n * MILLION)) for n in (1, 4)))
    what = "seconds a transition, 1,000,000 in one file against 4,000,000 in four"
    remark = f"{1e9 * one / MILLION:.0f} and {1e9 * four / (4 * MILLION):.0f} ns"
    return Row(what, f"{4 * one / four:.2f} ×", "≤ 1.3 ×", remark)


def start_up(scratch: Scratch) -> list[Row]:
    """The start-up of the command, and the paper's protocol compared with the published package."""
    generate = (COMMAND, "generate", "random", "--overwrite")
    modules = scratch.run(sys.executable, "-c", MODULES).split()
    help_seconds, ten, libraries, paper, theirs = paired(
        lambda: scratch.run(COMMAND, "--help"),
        lambda: scratch.run(*generate, "--set", "steps=1", "--out", "ten"),
        lambda: scratch.run(sys.executable, "-c", IMPORTS, *modules),
        lambda: scratch.run(*generate, "--out", "paper"),
        lambda: scratch.run(sys.executable, "-W", "ignore", "-c", PUBLISHED, "record"),
    )
    imports = f"{ten:.2f} s; the imports of the same modules, without ibdata's own, take {libraries:.2f} s"
    what, remark = "the paper's 10,000 rows, against the published package", "start-up included"
    return [
        Row("ibdata --help", f"{help_seconds:.2f} s"),
        Row("ibdata generate, 10 rows, against its imports", f"{ten / libraries:.2f} ×", "≤ 1.2 ×", imports),
        Row(what, f"{paper / theirs:.2f} ×", "", f"{paper:.2f} s and {theirs:.2f} s, {remark}"),
        *first_command(scratch),
        custom_policy(scratch),
    ]


def first_command(scratch: Scratch) -> list[Row]:
    """The processor time of the README's first command in an empty cache, interpreted and compiled."""

    def processor(*command: Any, **environment: str) -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        scratch.run(*command, **environment)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    command = (COMMAND, "generate", "--config", "random.yaml", "--out")
    rounds = [
        (
            processor(sys.executable, "-c", "import ibdata.cli.make, ibdata.generation.generate"),
            processor(*command, f"first-{i}", IBDATA_CACHE_DIR=f"empty-{i}"),
            processor(*command, f"compiled-{i}", IBDATA_CACHE_DIR=f"full-{i}", IBDATA_COMPILE="1"),
        )
        for i in range(3)
    ]
    imports, first, compiled = map(statistics.median, zip(*rounds, strict=True))
    what, remark = "on a new machine, against its imports", f"against {imports:.1f} s of a processor"
    return [
        Row(f"the first command {what}", f"{first / imports:.1f} ×", "≤ 4.5 ×", f"{first:.1f} s {remark}"),
        Row(f"a first compiled run {what}", f"{compiled / imports:.1f} ×", "", f"{compiled:.1f} s {remark}"),
    ]


def custom_policy(scratch: Scratch) -> Row:
    """What a custom policy costs a run, beyond the start of the process in which its code runs."""
    (scratch.folder / "still.py").write_text(POLICY)
    sys.path.insert(0, str(scratch.folder))
    plain = described(10_000)
    custom = described(10_000, policies=[{"kind": "custom", "target": "still:Still"}])

    def start() -> None:
        with closing(Worker(DatasetSpec.of(plain), scratch.folder)) as worker:
            worker.call(bool)

    run, without, started = paired(
        lambda: scratch.generate(custom, allow_code=True), lambda: scratch.generate(plain), start
    )
    what, remark = "a custom policy in Python, beyond its process", f"that starts in {started:.2f} s"
    return Row(what, f"{run - without - started:.2f} s", "≤ 0.15 s", remark)


def scaling(scratch: Scratch, full: bool) -> dict[int, Child]:
    """Runs by their number of transitions."""
    sizes = (10_000, 100_000, MILLION, 10 * MILLION, *([100 * MILLION] if full else []))
    return {rows: scratch.child(described(rows)) for rows in sizes}


def scaled(runs: dict[int, Child]) -> list[Row]:
    """Time and peak memory, by the number of transitions."""
    rows = []
    for n, run in runs.items():
        rows.append(
            Row(f"{n:,} transitions", f"{1e9 * run.seconds / n:.0f} ns each", "", f"peak {run.peak:.0f} MB")
        )
    largest, peak = max(runs), max(run.peak for run in runs.values())
    ratio = runs[largest].peak / runs[MILLION].peak
    rows.append(Row(f"peak memory, {largest:,} against 1,000,000", f"{ratio:.2f} ×", "≤ 1.1 ×"))
    return [*rows, Row("peak memory", f"{peak:.0f} MB", "≤ 600 MB")]


def sizes(scratch: Scratch) -> list[Row]:
    """Bytes per row for each kind of latent state."""
    rows = []
    for latent, target in ((False, ""), (True, "≤ 81"), ("full", "≤ 105"), ("next", "")):
        dataset = scratch.generate(described(100_000, output={"latent": latent}))
        what = f"bytes a row, latent: {json.dumps(latent).strip(chr(34))}"
        rows.append(Row(what, f"{dataset.stored.manifest.data_bytes / len(dataset):.1f}", target))
    return rows
