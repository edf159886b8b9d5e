"""Threads, worker processes and those of Ray make the files of one, and end with the run whatever happens."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from helpers import python
from helpers.datasets import FOUR_SHARDS as TINY
from helpers.folders import contents, part_of, receipts

import ibdata
from ibdata import Experiment, IbdataError
from ibdata.experiment import load
from ibdata.generation import ray, workers
from ibdata.generation.process import WorkerTask
from ibdata.plan.dataset_spec import DatasetSpec

slow = pytest.mark.slow  # a process starts in more than a second


DIVISION = [  # rows, processors, --workers, the policy; processes and threads
    (10**6, 1, None, "random", (1, 1)),
    (10**9, 4, None, "random", (1, 4)),
    (10**8, 64, None, "random", (64, 1)),
    (10**8, 8, 2, "random", (2, 4)),
    (2 * 10**6, 8, 16, "random", (2, 4)),
    (10**8, 8, None, {"kind": "custom", "target": "mine:Mine"}, (8, 1)),
]


@pytest.mark.parametrize(("rows", "processors", "asked", "policy", "expected"), DIVISION)
def test_the_division_follows_from_the_work(monkeypatch, rows, processors, asked, policy, expected):
    monkeypatch.setattr(workers, "available_processors", lambda: processors)
    plain = {"name": "x", "setpoints": 70, "policies": [policy], "episodes": rows // 1000}
    spec = DatasetSpec.of(Experiment.model_validate(plain))
    assert workers.divide(spec, spec.shards, asked) == expected


SCRIPT = f"""
import ibdata, sys
print(ibdata.generate(ibdata.Experiment.model_validate({TINY.plain()}), "out", workers=2).content_root)
print(*[name for name in ("pandas", "polars", "duckdb", "matplotlib") if name in sys.modules])
"""
WAYS = {"script": ["plain.py"], "stdin": ["-"], "-m": ["-m", "plain"]}


@slow
@pytest.mark.parametrize("way", WAYS)
def test_a_script_needs_no_guard(tiny, way):
    """Code without `if __name__ == "__main__"` runs once with several workers, and loads no reader."""
    Path("plain.py").write_text(SCRIPT)
    given = SCRIPT if way == "stdin" else None
    child = subprocess.run(
        [sys.executable, "-W", "error", *WAYS[way]], input=given, capture_output=True, text=True, timeout=120
    )
    assert (child.stdout, child.stderr) == (f"{tiny[0].content_root}\n\n", "")


# --- a policy by which workers fail

FAILING = """
import os, pathlib, signal, time

class Own:
    def act(self, history, u):
        if history[0, 0, 0] == 70 and pathlib.Path("fail").exists():
            exec(pathlib.Path("fail").read_text())
        return 0 * history[:, 0, :3]
"""


@pytest.fixture
def own():
    """A function that generates with a policy that executes a text at the setpoint 70."""
    Path("failing.py").write_text(FAILING)
    policies = [{"kind": "custom", "target": "failing.py:Own"}]
    Path("own.yaml").write_text(json.dumps({**TINY.plain(), "policies": policies}))

    def run(text, **options):
        Path("fail").write_text(text)
        return ibdata.generate("own.yaml", "out", allow_code=True, **{"workers": 2, **options})

    return run


@slow
def test_a_killed_worker_ends_the_run_with_advice(own):
    """And the same command goes on without making shards again."""
    others = (
        "len(list(pathlib.Path('.out.part/run/receipts').glob('*'))) == 2"  # the shards of the other setpoint
    )
    line = "^a worker process ended with code -9, perhaps for lack of memory; run again with few"
    with pytest.raises(IbdataError, match=line):
        own(f"while not {others}: time.sleep(0.05)\nos.kill(os.getpid(), signal.SIGKILL)")
    kept = {path for path, data in contents(part_of("out")).items() if data and path.endswith(".parquet")}
    assert len(receipts("out")) == len(kept) == 2
    made = own("")
    assert {Path(path).name for path in kept} <= {path.name for path in Path("out/data").iterdir()}
    assert ibdata.validate(made.path) == []


RUN = "import ibdata; ibdata.generate('own.yaml', 'out', workers=2, allow_code=True)"


@slow
def test_workers_end_with_a_run_that_is_killed(own):
    """Also in the middle of a shard. For other signals, see tests/faults."""
    with pytest.raises(IbdataError):
        own("raise RuntimeError", workers=1)  # so that only the shards that fail are left
    Path("fail").write_text("open(f'worker-{os.getpid()}', 'w').close(); time.sleep(600)")
    process = subprocess.Popen([sys.executable, "-c", RUN], stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while len(found := list(Path().glob("worker-*"))) < 2 and time.monotonic() < deadline:
        time.sleep(0.05)
    process.kill()
    assert process.wait(timeout=60) != 0
    pids = [int(path.name.partition("-")[2]) for path in found]
    assert len(pids) == 2
    while (alive := [pid for pid in pids if is_running(pid)]) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert alive == []


def is_running(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


REPAIR = """
import ibdata
ibdata.repair(".", workers=2)
experiment = {"name": "x", "setpoints": 70, "episodes": 2, "steps": 3, "output": {"shard_rows": 3}}
ibdata.generate(experiment | {"policies": ["random"]}, "../again", workers=2)
"""


@slow
def test_files_in_the_folder_of_a_dataset_do_not_run(tiny, tmp_path):
    """Workers that are started in a folder import nothing from it, whatever its files are called."""
    (tmp_path / "script.py").write_text(REPAIR)
    made = ibdata.generate(TINY, "theirs", workers=1).path
    for name in (*sys.stdlib_module_names, "numpy", "pyarrow", "ibdata"):
        (made / f"{name}.py").write_text(f"open('../{name} was imported', 'w'); raise SystemExit")
    for path in (made / "data").iterdir():
        os.truncate(path, 100)
    child = python(tmp_path / "script.py", cwd=made)
    assert child.returncode == 0, child.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["again", "script.py", "theirs"]


def test_another_run_at_the_same_place_is_another_run(tmp_path, monkeypatch):
    seeds = []
    monkeypatch.setattr(ray, "agree", lambda spec, root: None)
    monkeypatch.setattr(ray, "make_shard", lambda spec, *rest: seeds.append(spec.experiments[0].seed))
    monkeypatch.setattr("ibdata._system.processes.purpose", "test")
    for seed in (1, 2, 2):
        plain = {"name": "x", "setpoints": 70, "policies": ["random"], "steps": 2, "seed": seed}
        spec = DatasetSpec.of(load(plain))
        task = WorkerTask(spec, tmp_path, tmp_path)
        ray._work(task, spec.shards[0])
    assert seeds == [1, 2, 2]


@slow
def test_so_many_processes_make_the_shards_as_are_asked_for(tiny, monkeypatch, files):
    begun, real = [], workers.Worker

    class Noted(real):
        def __init__(self, *args):
            begun.append(args)
            super().__init__(*args)

    monkeypatch.setattr(workers, "Worker", Noted)
    made = ibdata.generate(TINY, "two", workers=2)
    assert len(begun) == 2
    assert files(made.path) == files(tiny[0].path)
    ibdata.generate(TINY, "one", workers=1)
    assert len(begun) == 2
