"""Worker processes end with their parent, and import nothing from the folder in which they are started."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import pytest
from helpers.python import python

import ibdata

SCRIPT = """
import ibdata
ibdata.repair(".", workers=2)
experiment = {"name": "x", "setpoints": 70, "episodes": 2, "steps": 3, "output": {"shard_rows": 3}}
ibdata.generate(experiment | {"policies": ["random"]}, "../again", workers=2)
"""


@pytest.mark.slow  # a process starts in more than a second
def test_files_in_the_folder_of_a_dataset_do_not_run_with_several_workers(tmp_path):
    (tmp_path / "script.py").write_text(SCRIPT)
    experiment = ibdata.Experiment(
        name="x", setpoints=70, policies=["safe"], episodes=4, steps=3, output={"shard_rows": 6}
    )
    made = ibdata.generate(experiment, tmp_path / "theirs", workers=1)
    for name in (*sys.stdlib_module_names, "numpy", "pyarrow", "ibdata"):
        Path(made.path, f"{name}.py").write_text(f"open('../{name} was imported', 'w'); raise SystemExit")
    for path in Path(made.path, "data").iterdir():
        os.truncate(path, 100)
    child = python(tmp_path / "script.py", cwd=made.path)
    assert child.returncode == 0, child.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["again", "script.py", "theirs"]


KILLED = """
import os, signal, time
from ibdata.system.processes import Spawning

class Slow:
    def __reduce__(self):
        return time.sleep, (600,)

Spawning().Process(target=Slow()).start()
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_worker_that_is_still_importing_ends_when_its_parent_is_killed(tmp_path):
    (tmp_path / "script.py").write_text(KILLED)
    child = python(tmp_path / "script.py", timeout=60)  # the worker holds the pipe of its parent's output
    assert child.returncode == -signal.SIGKILL
    assert child.stderr == ""
