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
from helpers.folders import contents
from helpers.own_code import PLAIN, generate, sha256
from helpers.python import python
from helpers.versions import POLICY

import ibdata
from ibdata import Experiment
from ibdata import open as read_dataset
from ibdata.errors import UsageError

pytestmark = pytest.mark.slow
AT_70 = "sys.exit(0) if history[0, 0, 0] > 50 else None"
GO = "os.chdir('elsewhere') if os.path.isdir('elsewhere') else None"
STRAY = """
    import os, sys
    print("imported")
    {module}

    class Own:
        def __init__(self):
            print("made")
            {made}
        def act(self, history, u):
            print("acts")
            {act}
            return 2.0 * u - 1.0
        def log_prob(self, history, action):
            print("judges")
            {log_prob}
            return action[:, 0]
"""
PLACES = ("module", "made", "act", "log_prob")


@pytest.fixture
def stray(here):
    """A function that writes the policy with a statement at a place."""

    def write(place="module", code="pass"):
        parts = {**dict.fromkeys(PLACES, "pass"), place: code}
        (here / "mine.py").write_text(textwrap.dedent(STRAY).format(**parts))

    return write


def test_a_policy_of_the_script_itself_is_refused(here):
    """Workers cannot import what a script defines, so `__main__` is no module of a policy."""
    policies = [{"kind": "custom", "target": "__main__:X"}]
    experiment = Experiment.model_validate({**PLAIN, "policies": policies})
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
def test_a_script_that_names_itself_is_told_so(tmp_path, call):
    """A script without a guard that names its own file as the policy gets one error, and no endless loop."""
    (tmp_path / "train.py").write_text(NAMES_ITSELF.format(policy=POLICY, call=call))
    child = python("train.py", cwd=tmp_path)
    assert "UsageError: train.py:Own: calls ibdata with itself as a policy while" in child.stderr
    assert len(child.stderr.splitlines()) < 100
    assert not (tmp_path / "out").exists()


PLAYED = "policy custom: episode 2: step 0: "
GIVEN = "it was given histories (1, 1, 6) and random numbers (1, 3)"


@pytest.mark.parametrize("workers", ["1", "2"])
@pytest.mark.parametrize(
    ("place", "code", "line"),
    [
        ("module", "sys.exit(0)", "mine:Own: cannot be loaded: mine.py:4: SystemExit: 0"),
        ("made", "sys.exit(0)", "mine:Own: cannot be loaded: mine.py:9: SystemExit: 0"),
        ("act", AT_70, f"{PLAYED}mine.py:12: SystemExit: 0; {GIVEN}"),
        ("log_prob", AT_70, f"{PLAYED}mine.py:16: SystemExit: 0"),
    ],
)
def test_a_policy_that_exits_is_an_error(stray, ibdata, workers, place, code, line):
    """`sys.exit(0)` in a policy is an error that names it, and not the end of the command."""
    stray(place, code)
    done = ibdata("generate", "-q", "own.yaml", "--out", "out", "--allow-code", "--workers", workers)
    last = done.stderr.splitlines()[-1]
    assert last.removeprefix("ibdata: ").replace("episode 3", "episode 2") == line
    assert (done.returncode, done.stdout) == (1, "")


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("place", ["module", "act"])
@pytest.mark.parametrize("way", ["whole", "range"])
def test_code_that_changes_the_folder_does_no_harm(here, stray, place, workers, way):
    """A policy that goes to another folder leaves the dataset, and the session, where they were."""
    (here / "elsewhere").mkdir()
    stray(place, GO)
    if way == "whole":
        generate(workers=workers)
    else:
        ibdata.generate_shards("own.yaml", "1/1", "out", workers=workers, allow_code=True)
        ibdata.finalize("out")
    assert Path.cwd() == here
    assert contents("elsewhere") == {}
    assert ibdata.validate("out") == []


def test_code_that_changes_the_folder_repairs_what_was_named(here, stray):
    """A repair by a policy that goes to another folder leaves the dataset of that name there alone."""
    stray("module", GO)
    generate()
    shutil.copytree("out", "elsewhere/out")
    before = contents("elsewhere")
    next(Path("out/data").iterdir()).write_bytes(b"")
    assert ibdata.repair("out", allow_code=True)
    assert Path.cwd() == here
    assert ibdata.validate("out") == []
    assert contents("elsewhere") == before


@pytest.mark.parametrize("workers", ["1", "2"])
def test_what_a_policy_prints_goes_to_stderr(stray, workers, command):
    """What a policy prints does not come between what a command answers."""
    stray()
    args = ["generate", "-q", "--json", "own.yaml", "--allow-code", "--workers", workers]
    done = subprocess.run([command, *args], capture_output=True, text=True, timeout=120)
    assert json.loads(done.stdout)["rows"] == 16
    assert {"imported", "made", "acts", "judges"} <= set(done.stderr.split())


def test_bytecode_of_other_code_does_not_run(here):
    """Bytecode that fits a file's time and size, and not its text, is passed over."""
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

    @compiled
    def called(u):
        return scaled(2.0 * u - 1.0)

    class Own:
        def act(self, history, u):
            return 0.5 * (constant(u) + called(u))
    """
SCALED = """
    from ibdata.numerics.compiled import compiled
    SIZE = {0}

    @compiled
    def scaled(x):
        return {0} * x
    """


def test_machine_code_of_other_files_does_not_run(here, ibdata):
    """numba's cache knows a function's own file, not those whose numbers and functions it compiles in."""
    (here / "mine.py").write_text(textwrap.dedent(FAST))
    policy = {"kind": "custom", "target": "mine:Own", "uniforms": 3}
    (here / "own.yaml").write_text(json.dumps({**PLAIN, "policies": [policy]}))
    (here / "policy.yaml").write_text(json.dumps(policy))
    returns = []
    for size in ("0.25", "0.75", "0.25"):
        (here / "helper.py").write_text(textwrap.dedent(SCALED).format(size))
        done = ibdata("generate", "-q", "own.yaml", "--allow-code", "--out", size, "--overwrite")
        assert done.returncode == 0, done.stderr
        done = ibdata("evaluate", "--policy", "policy.yaml", "--allow-code", "--episodes", "2", "--json")
        returns.append(json.loads(done.stdout)["results"][0]["mean_return"])
    small, large = (read_dataset(size).arrays()["actions"] for size in ("0.25", "0.75"))
    np.testing.assert_allclose(3 * small, large, rtol=1e-5)
    assert returns[0] == returns[2] != returns[1]
