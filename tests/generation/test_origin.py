"""Custom code: its origin is noted, another origin is refused, and what else it does makes no harm."""

import json
from pathlib import Path

import pytest
from helpers.folders import run_of
from helpers.own_code import FILES, SEVERAL
from helpers.refusals import refused

import ibdata
from ibdata.dataset.models import Code
from ibdata.errors import UsageError
from ibdata.generation.record import Record

pytestmark = pytest.mark.slow


@pytest.fixture
def own(code):
    """A policy of several files in the current folder."""
    return code(FILES, **SEVERAL)


@pytest.mark.parametrize(("path", "named"), [("mine.py", "mine:Own"), ("lazy.py", "lazy.py")])
def test_a_run_goes_on_with_the_same_code_only(own, path, named):
    """And its data are taken, read and made again with it only."""
    own.stopped()
    kept = run_of("out")
    before = sorted(Path(".out.part").rglob("*"))
    edited = {path: FILES[path] + "\n"}
    own.edit(edited)
    for options in ({"shards": "1/2"}, {}):
        line = f"^out: holds an unfinished run with other code, in {named}, 2 of 4 shards; remove "
        refused(line, own.run, **options)
    assert sorted(Path(".out.part").rglob("*")) == before
    own.edit(FILES)
    shards = {path.name for path in kept.glob("dataset/data/*")}
    assert own.run().content_root == own.run("whole").content_root
    # Those that have receipts are kept; the file of one that was being made when the run stopped is not.
    assert len(shards & {path.name for path in Path("out/data").iterdir()}) >= 2
    own.edit(edited)
    refused(f"^out: holds .* other code, in {named}; overwrite=True", own.run)
    with pytest.raises(UsageError, match=f"^out: found other code than .*made with, in {named}; restore"):
        ibdata.importance("out", ibdata.load("own.yaml").policies[0], allow_code=True)


CODE = {"code": [Code(target="mine:Own", version=None, sha256="0" * 64)]}
OTHERS = {
    "found other code .*, in mine:Own": CODE,
    "a worker computes other bits": {"known_answer": "0" * 64},
}


@pytest.mark.parametrize(("line", "noted"), OTHERS.items())
def test_a_worker_with_other_code_or_bits_is_refused(own, monkeypatch, noted, line):
    write = Record.write
    monkeypatch.setattr(Record, "write", lambda record, run: write(record.model_copy(update=noted), run))
    refused(line, own.run, workers=2)
    assert not Path("out").exists()


def test_finalize_imports_nothing(own):
    own.run(shards="1/1")
    known = own.sha256("mine.py")
    own.edit({"mine.py": "raise RuntimeError('imported')"})
    (code,) = ibdata.finalize("out").manifest["code"]
    assert code["sha256"] == known


STRAY = """
    import sys
    print("imported")

    class Own:
        def act(self, history, u):
            print("acts")
            {act}
            return 2.0 * u - 1.0
"""


def test_a_policy_that_exits_is_an_error(own, ibdata):
    """What it prints goes to stderr."""
    own.edit({"mine.py": STRAY.format(act="sys.exit(0) if history[0, 0, 0] == 70 else 0")})
    args = ("generate", "-q", "--json", "own.yaml", "--out", "out", "--allow-code", "--workers", "2")
    done = ibdata(*args)
    last = done.stderr.splitlines()[-1].replace("episode 3", "episode 2")
    given = "it was given observations (1, 1, 6) and random numbers (1, 3)"
    assert last.endswith(f"policy custom: episode 2: step 0: mine.py:8: SystemExit: 0; {given}")
    assert done.returncode == 1
    own.edit({"mine.py": STRAY.format(act="pass")})
    done = ibdata(*args, "--overwrite")
    assert json.loads(done.stdout)["rows"] == 16
    assert {"imported", "acts"} <= set(done.stderr.split())
