"""Experiments for measurements, timers, and runs in a temporary folder."""

import json
import os
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import ibdata
from ibdata import Experiment

COMMAND = Path(sys.executable).with_name("ibdata")
TIMES = 5
MILLION = 1_000_000
CHILD = """
import json, os, shutil, sys, time
for name in ("small", "child"):
    shutil.rmtree(name, ignore_errors=True)
experiment, small, processors = json.loads(sys.argv[1])
if processors:
    os.sched_setaffinity(0, set(list(os.sched_getaffinity(0))[:processors]))
import pyarrow
pyarrow.set_cpu_count(processors or pyarrow.cpu_count())
import ibdata
ibdata.generate(ibdata.Experiment.model_validate(small), "small")
start, before = time.perf_counter(), time.process_time()
ibdata.generate(ibdata.Experiment.model_validate(experiment), "child")
took = time.perf_counter() - start, time.process_time() - before
peak = [line for line in open("/proc/self/status") if line.startswith("VmHWM")][0].split()[1]
print(json.dumps([*took, int(peak) / 1024]))
"""


class Row(NamedTuple):
    """A line of a table; docs/performance.md leaves out the goals."""

    what: str
    measured: str
    goal: str = ""
    remark: str = ""


class Child(NamedTuple):
    """What a run in a process of its own took: seconds, seconds of processor time, and peak memory in MB."""

    seconds: float
    processor: float
    peak: float


def described(rows: int, **changes: Any) -> Experiment:
    """An experiment with ten setpoints, episodes of 1000 steps and this number of rows."""
    plain = {
        "name": "benchmark",
        "setpoints": {"start": 10, "stop": 100, "step": 10},
        "policies": [{"kind": "random"}],
        "episodes": rows // 10_000,
    }
    return Experiment.model_validate({**plain, **changes})


def timed(call: Callable[[], Any]) -> float:
    """The duration of a call in seconds."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def paired(*calls: Callable[[], Any], times: int = TIMES) -> list[float]:
    """The median duration of each call in seconds. The calls take turns; a first round does not count."""
    for call in calls:
        call()
    rounds = [[timed(call) for call in calls] for _ in range(times)]
    return [statistics.median(column) for column in zip(*rounds, strict=True)]


class Scratch:
    """Runs in a temporary folder."""

    def __init__(self, folder: str) -> None:
        self.folder = Path(folder)

    def generate(
        self, experiment: Experiment, workers: int | None = 1, allow_code: bool = False
    ) -> ibdata.Dataset:
        """Generate a dataset in place of the one before."""
        shutil.rmtree(self.folder / "x", ignore_errors=True)
        made: ibdata.Dataset = ibdata.generate(
            experiment, self.folder / "x", workers=workers, allow_code=allow_code
        )
        return made

    def run(self, *command: Any, **environment: str) -> str:
        """Run a command with some variables of the environment, and return what it prints last."""
        variables = {**os.environ, **environment}
        done = subprocess.run(
            command, cwd=self.folder, env=variables, capture_output=True, text=True, check=True
        )
        return (done.stdout.splitlines() or [""])[-1]

    def script(self, text: str, *arguments: str) -> float:
        """Run a script in three processes, and return the median of the numbers that they print."""
        command = (sys.executable, "-W", "ignore", "-c", text, *arguments)
        return statistics.median(float(self.run(*command)) for _ in range(3))

    def child(self, experiment: Experiment, processors: int | None = None) -> Child:
        """Measure a run, after a small one, in a process of its own that may use so many processors."""
        given = json.dumps([experiment.plain(), described(10_000).plain(), processors])
        (self.folder / "child.py").write_text(CHILD)
        return Child(*json.loads(self.run(sys.executable, "child.py", given)))
