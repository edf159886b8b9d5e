"""Custom code: its origin is noted, another origin is refused, and what else it does makes no harm."""

import json
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from helpers import python
from helpers.folders import run_of
from helpers.own_code import PLAIN, POLICY, generate, sha256, stopped

import ibdata
import ibdata as library
from ibdata.dataset.models import Code
from ibdata.errors import UsageError
from ibdata.generation.record import Record

pytestmark = pytest.mark.slow


@pytest.fixture
def whole(here):
    """The current folder, with a policy that does not stop."""
    (here / "at-70-stop.py").unlink()
    return here


@pytest.mark.parametrize(
    ("path", "named"),
    [("mine.py", "mine:Own"), *((path, path) for path in ("helper.py", "lazy.py", "weights.txt"))],
)
def test_a_run_goes_on_with_the_same_code_only(here, path, named, capsys):
    stopped()
    kept = run_of("out")
    was = (here / path).read_bytes()
    (here / path).write_bytes(was + b"\n")
    before = sorted(Path(".out.part").rglob("*"))
    line = f"^out: holds an unfinished run with other code, in {named}; run without --shards to make the dat"
    with pytest.raises(UsageError, match=line):
        generate(shards="1/2")
    assert sorted(Path(".out.part").rglob("*")) == before
    Path("at-70-stop.py").write_text("raise RuntimeError('stopped')")
    stopped(others=2)
    notice = f"out: an unfinished run with other code, in {named} stays in {kept.resolve()}, with 2 finished"
    assert notice in capsys.readouterr().err
    (here / path).write_bytes(was)
    shards = {path.name for path in kept.glob("dataset/data/*")}
    assert generate().content_root == generate("whole").content_root
    # Those that have receipts are kept; the file of one that was being made when the run stopped is not.
    assert len(shards & {path.name for path in Path("out/data").iterdir()}) >= 2


def test_a_helper_is_imported_as_it_is_now_and_not_here(whole):
    before = set(sys.modules)
    for size, workers in ((0.75, 1), (0.125, 2)):  # of other lengths: Python compares seconds and bytes
        Path("helper.py").write_text(f"SIZE = {size}")
        actions = generate(f"out-{size}", workers=workers).arrays()["actions"]
        assert 0.25 * size < abs(actions).max() <= 0.5 * size  # the weights are 0.5
    assert not {"mine", "helper", "lazy"} & (set(sys.modules) - before)


def test_declared_files_lie_beside_the_yaml_or_here(whole):
    Path("beside").mkdir()
    Path("own.yaml").rename("beside/own.yaml")
    Path("mine.py").write_text("def Own(observations):\n    return 0.0 * observations[:, :3]")
    for path in ("weights.txt", "beside/weights.txt"):
        Path(path).write_text("0.75")
        (made,) = ibdata.generate("beside/own.yaml", f"of-{path[:6]}", allow_code=True, workers=1).manifest[
            "code"
        ]
        assert made["files"]["weights.txt"] == sha256(path)
        Path(path).unlink()
    with pytest.raises(UsageError, match=r"^mine:Own: files: found no file 'weights.txt', expected it besi"):
        ibdata.generate("beside/own.yaml", "third", allow_code=True, workers=1)


def test_another_version_of_an_installed_library_is_refused(here):
    (here / "lazy.py").write_text("from scipy import special\nSIGN = -1.0")
    stopped()
    note = Record.read(run_of("out"))
    assert note.code[0].distributions.keys() == {"numba", "numpy", "scipy"}
    note.code[0].distributions["scipy"] = "0.0.1"
    note.write(run_of("out"))
    with pytest.raises(UsageError, match="with other code, in the version of scipy;"):
        generate(shards="1/2")


@pytest.mark.parametrize(
    ("noted", "line"),
    [
        (
            {"code": [Code(target="mine:Own", version=None, sha256="0" * 64)]},
            "found other code .*, in mine:Own",
        ),
        ({"known_answer": "0" * 64}, "a worker computes other bits"),
    ],
    ids=["code", "bits"],
)
def test_a_worker_with_other_code_or_bits_is_refused(whole, monkeypatch, noted, line):
    write = Record.write
    monkeypatch.setattr(Record, "write", lambda record, run: write(record.model_copy(update=noted), run))
    with pytest.raises(UsageError, match=line):
        generate(workers=2)
    assert not (whole / "out").exists()


def test_finalize_imports_nothing(whole):
    generate(shards="1/1")
    known = sha256("mine.py")
    Path("mine.py").write_text("raise RuntimeError('imported')")
    (code,) = ibdata.finalize("out").manifest["code"]
    assert code["sha256"] == known


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
    policy = {"kind": "custom", "target": "mine:Own", "draws": 3}
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
