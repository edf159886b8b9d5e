"""A custom policy that exits, prints, changes the folder or leaves machine code behind does no harm."""

import json
import textwrap
from pathlib import Path

import numpy as np
import pytest
from helpers.folders import contents
from helpers.own_code import PLAIN, generate
from helpers.python import python
from helpers.versions import POLICY

import ibdata as library

pytestmark = pytest.mark.slow
AT_70 = "sys.exit(0) if history[0, 0, 0] == 70 else None"
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
        def log_density(self, given, action):
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
    """Without a guard; and it does not start itself for ever."""
    (tmp_path / "train.py").write_text(NAMES_ITSELF.format(policy=POLICY, call=call))
    child = python("train.py", cwd=tmp_path)
    assert "UsageError: train.py:Own: calls ibdata with itself as a policy while" in child.stderr
    assert len(child.stderr.splitlines()) < 100
    assert not (tmp_path / "out").exists()


PLAYED = "policy custom: episode 2: step 0: "
GIVEN = "it was given observations (1, 1, 6) and random numbers (1, 3)"


@pytest.mark.parametrize("workers", ["1", "2"])
@pytest.mark.parametrize(
    ("place", "code", "line"),
    [
        ("module", "sys.exit(0)", "mine:Own: cannot be loaded: mine.py:4: SystemExit: 0"),
        ("made", "sys.exit(0)", "mine:Own: cannot be loaded: mine.py:9: SystemExit: 0"),
        ("act", AT_70, f"{PLAYED}mine.py:12: SystemExit: 0; {GIVEN}"),
        ("log_prob", AT_70.replace("history", "given.observations"), f"{PLAYED}mine.py:16: SystemExit: 0"),
    ],
)
def test_a_policy_that_exits_is_an_error(stray, ibdata, workers, place, code, line):
    stray(place, code)
    done = ibdata("generate", "-q", "own.yaml", "--out", "out", "--allow-code", "--workers", workers)
    last = done.stderr.splitlines()[-1]
    assert last.removeprefix("ibdata: ").replace("episode 3", "episode 2") == line
    assert (done.returncode, done.stdout) == (1, "")


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("place", ["module", "act"])
def test_code_that_changes_the_folder_does_no_harm(here, stray, place, workers):
    (here / "elsewhere").mkdir()
    stray(place, GO)
    generate(workers=workers)
    assert Path.cwd() == here
    assert contents("elsewhere") == {}
    assert library.validate("out") == []


@pytest.mark.parametrize("workers", ["1", "2"])
def test_what_a_policy_prints_goes_to_stderr(stray, workers, ibdata):
    stray()
    done = ibdata("generate", "-q", "--json", "own.yaml", "--allow-code", "--workers", workers)
    assert json.loads(done.stdout)["rows"] == 16
    assert {"imported", "made", "acts", "judges"} <= set(done.stderr.split())


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
    small, large = (library.open(size).arrays()["actions"] for size in ("0.25", "0.75"))
    np.testing.assert_allclose(3 * small, large, rtol=1e-5)
    assert returns[0] == returns[2] != returns[1]
