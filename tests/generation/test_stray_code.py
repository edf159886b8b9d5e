"""A custom policy that exits, prints, changes the folder or leaves old bytecode behind does no harm."""

from __future__ import annotations

import json
import os
import py_compile
import shutil
import subprocess
import textwrap
from pathlib import Path

import numpy as np
import pytest
from helpers.own_code import PLAIN, generate, sha256
from helpers.python import python
from helpers.versions import POLICY

import ibdata
from ibdata import Experiment
from ibdata import open as read_dataset
from ibdata.errors import UsageError

pytestmark = pytest.mark.slow


def test_a_policy_of_the_script_itself_is_refused(here):
    experiment = Experiment.model_validate(
        {**PLAIN, "policies": [{"kind": "custom", "target": "__main__:X"}]}
    )
    with pytest.raises(UsageError, match="found the target __main__:X, which is in the script itself"):
        ibdata.generate(experiment, "out", workers=2, allow_code=True)


NAMES_ITSELF = """
import ibdata
{policy}
own = {{"kind": "custom", "target": "train.py:Own"}}
plain = {{"name": "x", "setpoints": 70, "episodes": 2, "steps": 3, "policies": [own]}}
ibdata.{call}
"""


@pytest.mark.parametrize(
    "call", ["generate(plain, 'out', workers=2, allow_code=True)", "evaluate(own, 70, episodes=2, steps=3)"]
)
def test_a_script_that_names_itself_as_the_policy_is_told_so(tmp_path, call):
    (tmp_path / "train.py").write_text(NAMES_ITSELF.format(policy=POLICY, call=call))
    child = python("train.py", cwd=tmp_path)
    assert "UsageError: train.py:Own: calls ibdata with itself as a policy while" in child.stderr
    assert len(child.stderr.splitlines()) < 100
    assert not (tmp_path / "out").exists()


ENDING = """
    import sys, multiprocessing
    {module}
    class Own:
        def __init__(self):
            {made}
        def act(self, history, u):
            {act}
            return 2.0 * u - 1.0
        def log_prob(self, history, action):
            {log_prob}
            return action[:, 0]
"""
AT_70 = "sys.exit(0) if history[0, 0, 0] > 50 else None"
PLAYED = "policy custom: episode 2: step 0: "
GIVEN = "it was given histories (1, 1, 6) and random numbers (1, 3)"


@pytest.mark.parametrize("lost", ["data", "meta/manifest.json"])
def test_code_that_goes_to_another_folder_repairs_the_dataset_that_was_named(here, lost):
    go = "os.chdir('elsewhere') if os.path.isdir('elsewhere') else None"
    (here / "mine.py").write_text(textwrap.dedent(ASTRAY).format(module=go, act="pass"))
    generate()
    other = here / "elsewhere" / "out"
    shutil.copytree("out", other)
    before = {path: path.read_bytes() for path in other.rglob("*") if path.is_file()}
    if lost == "data":
        next(Path("out/data").iterdir()).write_bytes(b"")
    else:
        Path("out", lost).unlink()
    assert ibdata.repair("out", allow_code=True)
    assert Path.cwd() == here
    assert ibdata.validate("out") == []
    assert {path: path.read_bytes() for path in other.rglob("*") if path.is_file()} == before


def test_bytecode_of_other_code_than_the_source_s_does_not_run(here):
    (here / "at-70-stop.py").unlink()
    times = os.stat("helper.py").st_mtime_ns
    py_compile.compile("helper.py")
    (here / "helper.py").write_text("SIZE = 0.50")
    os.utime("helper.py", ns=(times, times))
    made = generate()
    assert made.manifest["code"][0]["files"]["helper.py"] == sha256("helper.py")
    shutil.rmtree("__pycache__", ignore_errors=True)
    assert generate("again").content_root == made.content_root


FAST = """
    import numba
    from helper import SIZE, scaled
    from ibdata.numerics.compiled import compiled

    @numba.njit(cache=True)
    def constant(u):
        return SIZE * (2.0 * u - 1.0)

    @numba.vectorize(["float64(float64)"], cache=True)
    def elementwise(u):
        return SIZE * (2.0 * u - 1.0)

    @numba.guvectorize(["(float64[:], float64[:])"], "(k)->(k)", cache=True)
    def rows(u, out):
        for i in range(3):
            out[i] = SIZE * (2.0 * u[i] - 1.0)

    @compiled
    def called(u):
        return scaled(2.0 * u - 1.0)

    class Own:
        def act(self, history, u):
            return 0.25 * (constant(u) + elementwise(u) + rows(u) + called(u))
    """
SCALED = """
    from ibdata.numerics.compiled import compiled
    SIZE = {}

    @compiled
    def scaled(x):
        return {} * x
    """


def test_machine_code_of_other_files_does_not_run(here, ibdata):
    """numba only looks at a function's own file, not at those whose numbers and functions it compiles in."""
    (here / "mine.py").write_text(textwrap.dedent(FAST))
    policy = {"kind": "custom", "target": "mine:Own", "uniforms": 3}
    (here / "own.yaml").write_text(json.dumps({**PLAIN, "policies": [policy]}))
    (here / "policy.yaml").write_text(json.dumps(policy))
    returns = []
    for size in (0.25, 0.75, 0.25):
        (here / "helper.py").write_text(textwrap.dedent(SCALED).format(size, size))
        if str(size) not in os.listdir():
            done = ibdata("generate", "-q", "own.yaml", "--allow-code", "--workers", "1", "--out", str(size))
            assert done.returncode == 0, done.stderr
        done = ibdata("evaluate", "--policy", "policy.yaml", "--allow-code", "--episodes", "2", "--json")
        returns.append(json.loads(done.stdout)["results"][0]["mean_return"])
    small, large = (read_dataset(str(size)).arrays()["actions"] for size in (0.25, 0.75))
    np.testing.assert_allclose(3 * small, large, rtol=1e-5)
    assert returns[0] == returns[2] != returns[1]


@pytest.mark.slow
@pytest.mark.parametrize("workers", ["1", "2"])
@pytest.mark.parametrize(
    ("place", "code", "line"),
    [
        ("module", "sys.exit(0)", "mine:Own: cannot be loaded: mine.py:3: SystemExit: 0"),
        ("made", "sys.exit(0)", "mine:Own: cannot be loaded: mine.py:6: SystemExit: 0"),
        ("act", AT_70, f"{PLAYED}mine.py:8: SystemExit: 0; {GIVEN}"),
        ("log_prob", AT_70, f"{PLAYED}mine.py:11: SystemExit: 0"),
    ],
)
def test_a_policy_that_exits_is_an_error_that_names_it(here, ibdata, workers, place, code, line):
    parts = {**dict.fromkeys(("module", "made", "act", "log_prob"), "pass"), place: code}
    (here / "mine.py").write_text(textwrap.dedent(ENDING).format(**parts))
    done = ibdata(
        "generate", "-q", "--config", "own.yaml", "--out", "out", "--allow-code", "--workers", workers
    )
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert last.removeprefix("ibdata: ").replace("episode 3", "episode 2") == line
    assert done.stdout == ""


ASTRAY = """
    import os
    print("imported")
    {module}

    class Own:
        def __init__(self):
            print("made")
        def act(self, history, u):
            {act}
            print("acts")
            return 2.0 * u - 1.0
        def log_prob(self, history, action):
            print("judges")
            return action[:, 0]
"""


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("place", ["module", "act"])
@pytest.mark.parametrize("way", ["whole", "range"])
def test_code_that_goes_to_another_folder_leaves_the_dataset_where_it_was_asked_for(
    here, place, workers, way
):
    (here / "elsewhere").mkdir()
    go = "os.chdir('elsewhere') if os.path.isdir('elsewhere') else None"
    (here / "mine.py").write_text(
        textwrap.dedent(ASTRAY).format(**{"module": "pass", "act": "pass", place: go})
    )
    if way == "whole":
        made = generate(workers=workers)
    else:
        ibdata.generate_shards("own.yaml", "1/1", "out", workers=workers, allow_code=True)
        made = ibdata.finalize("out")
    assert made.path == Path("out")
    assert Path.cwd() == here
    assert list((here / "elsewhere").iterdir()) == []
    assert ibdata.validate("out") == []


@pytest.mark.slow
@pytest.mark.parametrize("workers", ["1", "2"])
def test_what_a_policy_prints_does_not_come_between_what_a_command_answers(here, workers, command):
    (here / "mine.py").write_text(textwrap.dedent(ASTRAY).format(module="pass", act="pass"))
    args = ["generate", "-q", "--json", "--config", "own.yaml", "--allow-code", "--workers", workers]
    done = subprocess.run([command, *args], capture_output=True, text=True, timeout=120)
    assert json.loads(done.stdout)["rows"] == 16
    assert {"imported", "made", "acts", "judges"} <= set(done.stderr.split())
