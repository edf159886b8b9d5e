"""A custom policy that exits, prints, changes the folder or leaves machine code behind does no harm."""

import json
import textwrap

import numpy as np
import pytest
from helpers.own_code import PLAIN
from helpers.python import python
from helpers.versions import POLICY

import ibdata as library

pytestmark = pytest.mark.slow
AT_70 = "sys.exit(0) if history[0, 0, 0] == 70 else None"
STRAY = """
    import sys
    print("imported")
    {module}

    class Own:
        def act(self, history, u):
            print("acts")
            {act}
            return 2.0 * u - 1.0
"""


@pytest.fixture
def stray(here):
    """A function that writes the policy with a statement at a place."""

    def write(place="module", code="pass"):
        parts = {"module": "pass", "act": "pass", place: code}
        (here / "mine.py").write_text(textwrap.dedent(STRAY).format(**parts))

    return write


NAMES_ITSELF = """
import ibdata
{policy}
own = {{"kind": "custom", "target": "train.py:Own"}}
plain = {{"name": "x", "setpoints": 70, "episodes": 2, "steps": 3, "policies": [own]}}
ibdata.generate(plain, 'out', workers=2, allow_code=True)
"""


def test_a_script_that_names_itself_is_told_so(tmp_path):
    """Without a guard; and it does not start itself for ever."""
    (tmp_path / "train.py").write_text(NAMES_ITSELF.format(policy=POLICY))
    child = python("train.py", cwd=tmp_path)
    assert "UsageError: train.py:Own: calls ibdata with itself as a policy while" in child.stderr
    assert len(child.stderr.splitlines()) < 100
    assert not (tmp_path / "out").exists()


PLAYED = "policy custom: episode 2: step 0: "
GIVEN = "it was given observations (1, 1, 6) and random numbers (1, 3)"


@pytest.mark.parametrize(
    ("place", "code", "line"),
    [
        ("module", "sys.exit(0)", "mine:Own: cannot be loaded: mine.py:4: SystemExit: 0"),
        ("act", AT_70, f"{PLAYED}mine.py:9: SystemExit: 0; {GIVEN}"),
    ],
)
def test_a_policy_that_exits_is_an_error(stray, ibdata, place, code, line):
    stray(place, code)
    done = ibdata("generate", "-q", "own.yaml", "--out", "out", "--allow-code", "--workers", "2")
    last = done.stderr.splitlines()[-1]
    assert last.removeprefix("ibdata: ").replace("episode 3", "episode 2") == line
    assert (done.returncode, done.stdout) == (1, "")


def test_what_a_policy_prints_goes_to_stderr(stray, ibdata):
    stray()
    done = ibdata("generate", "-q", "--json", "own.yaml", "--allow-code", "--workers", "2")
    assert json.loads(done.stdout)["rows"] == 16
    assert {"imported", "acts"} <= set(done.stderr.split())


FAST = """
    import numba
    from helper import SIZE

    @numba.njit(cache=True)
    def constant(u):
        return SIZE * (2.0 * u - 1.0)

    class Own:
        def act(self, history, u):
            return constant(u)
    """


def test_machine_code_of_other_files_does_not_run(here, ibdata):
    """numba's cache knows a function's own file, not those whose numbers it compiles in."""
    (here / "mine.py").write_text(textwrap.dedent(FAST))
    policy = {"kind": "custom", "target": "mine:Own", "uniforms": 3}
    (here / "own.yaml").write_text(json.dumps({**PLAIN, "policies": [policy]}))
    (here / "policy.yaml").write_text(json.dumps(policy))
    returns = []
    for size in ("0.25", "0.75", "0.25"):
        (here / "helper.py").write_text(f"SIZE = {size}")
        done = ibdata("generate", "-q", "own.yaml", "--allow-code", "--out", size, "--overwrite")
        assert done.returncode == 0, done.stderr
        done = ibdata("evaluate", "--policy", "policy.yaml", "--allow-code", "--episodes", "2", "--json")
        returns.append(json.loads(done.stdout)["results"][0]["mean_return"])
    small, large = (library.open(size).arrays()["actions"] for size in ("0.25", "0.75"))
    np.testing.assert_allclose(3 * small, large, rtol=1e-5)
    assert returns[0] == returns[2] != returns[1]
