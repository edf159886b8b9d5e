"""Experiments for measurements, timers, and a temporary folder for datasets."""

import json
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import ibdata
from ibdata import Experiment

COMMAND = Path(sys.executable).with_name("ibdata")
TIMES = 5
MILLION = 1_000_000
Row = tuple[str, str, str, str]  # what, measured, target, remark


def described(rows: int, policy: dict[str, Any] | None = None, **changes: Any) -> Experiment:
    """An experiment with ten setpoints, episodes of 1000 steps and this number of rows."""
    plain = {
        "name": "benchmark",
        "setpoints": {"start": 10, "stop": 100, "step": 10},
        "policies": [policy or {"kind": "random"}],
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


def processor_time(call: Callable[[], Any]) -> float:
    """The median processor time of a call in seconds, summed over all threads."""
    found = []
    for _ in range(TIMES):
        start = time.process_time()
        call()
        found.append(time.process_time() - start)
    return statistics.median(found)


class Scratch:
    """Runs in a temporary folder."""

    def __init__(self, folder: str) -> None:
        self.folder = Path(folder)

    def generate(self, experiment: Experiment, workers: int = 1, name: str = "x") -> ibdata.Dataset:
        """Generate a dataset, replacing an older one."""
        shutil.rmtree(self.folder / name, ignore_errors=True)
        return ibdata.generate(experiment, self.folder / name, workers=workers)

    def script(self, text: str, *arguments: str) -> float:
        """Run a script and return the number that it prints last."""
        done = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", text, *arguments],
            cwd=self.folder,
            capture_output=True,
            text=True,
            check=True,
        )
        return float(done.stdout.split()[-1])

    def child(self, experiment: Experiment) -> tuple[float, float]:
        """The duration (seconds) and peak memory (MB) of a run with one worker in a process of its own."""
        text = (
            "import json,sys,time,ibdata\n"
            "if __name__ == '__main__':\n"
            " e = ibdata.Experiment.model_validate(json.loads(sys.argv[1]))\n"
            " start = time.perf_counter(); ibdata.generate(e, 'child', workers=1)\n"
            " peak = [line for line in open('/proc/self/status') if line.startswith('VmHWM')][0].split()[1]\n"
            " print(json.dumps([time.perf_counter() - start, int(peak) / 1024]))\n"
        )
        (self.folder / "child.py").write_text(text)
        shutil.rmtree(self.folder / "child", ignore_errors=True)
        done = subprocess.run(
            [sys.executable, "child.py", json.dumps(experiment.plain())],
            cwd=self.folder,
            check=True,
            capture_output=True,
            text=True,
        )
        seconds, peak = json.loads(done.stdout)
        return seconds, peak
