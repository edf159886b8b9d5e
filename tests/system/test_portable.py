"""What holds on every system. `scripts/bridges windows` runs it and others that are marked so, with Wine."""

import json
import os
import re
import sys
from pathlib import Path

import pytest
from helpers import ROOT, python
from helpers.datasets import FOUR_SHARDS as TINY
from helpers.folders import contents, part_of, receipts
from helpers.splits import HALVES
from ruamel.yaml import YAML
from same_bits.child import HERE, experiments

import ibdata
from ibdata._system.lock import locked
from ibdata._system.part import resolved
from ibdata.errors import BusyError, IbdataError, UsageError

pytestmark = pytest.mark.portable
OTHER = TINY.model_copy(update={"seed": 1})
PLAIN = f"ibdata.Experiment.model_validate({TINY.plain()})"


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.slow
def test_the_command_makes_the_paper_s_batch_with_its_root(ibdata):
    """In a console with an old code page, which has few letters."""
    env = {**os.environ, "PYTHONUTF8": "0", "PYTHONIOENCODING": "cp1252"}
    made = ibdata("generate", "random.yaml", env=env)
    assert made.returncode == 0, made.stderr
    assert json.loads((ROOT / "docs/canonical.json").read_bytes())["random"]["content_root"] in made.stdout
    assert not part_of(Path("data/random")).exists()


def test_every_bit_is_that_of_linux():
    """Of datasets in float64 with all kinds of policies, and of an evaluation."""
    golden = YAML(typ="safe", pure=True).load(HERE / "golden.yaml")["roots"]["tiny"]
    made = [ibdata.generate(each, each.name, workers=1) for each in experiments("tiny")]
    assert {dataset.manifest["experiments"][0]["name"]: dataset.content_root for dataset in made} == golden
    [safe] = ibdata.evaluate(["safe"], setpoint=70, episodes=10).results
    assert safe.mean_return.hex() == "-0x1.a287113ac13cap+12"


@pytest.mark.slow
def test_a_killed_run_goes_on(tiny, files):
    """The system ends the process at once, in the middle of the third shard; the first two are kept."""
    code = f"""
import os
import ibdata
from ibdata.generation import workers

def make(spec, shard, *rest, real=workers.make_shard):
    if shard.number == 2:
        os.kill(os.getpid(), 9)
    real(spec, shard, *rest)

workers.make_shard, workers.MOST_THREADS = make, 1
ibdata.generate({PLAIN}, "out", workers=1)
"""
    assert python("-c", code).returncode != 0
    assert receipts(Path("out").absolute()) == ["00000.npy", "00001.npy"]
    kept = {path.name for path in part_of(Path("out")).rglob("part-0000[01]*")}
    assert not Path("out").exists()
    ibdata.generate(TINY, "out", workers=1)
    assert kept <= {path.name for path in Path("out/data").iterdir()}
    assert files("out") == files(tiny[0].path)
    assert list(Path().iterdir()) == [Path("out")]


def test_processes_make_the_same_dataset(tiny, files):
    ibdata.generate(TINY, "out", workers=2)
    assert files("out") == files(tiny[0].path)


def test_a_lock_is_held_by_one_process_or_shared():
    path = Path("folder/lock").absolute()
    other = f"""
from pathlib import Path
from ibdata.errors import BusyError
from ibdata._system.lock import locked
for shared in (True, False):
    try:
        with locked(Path({str(path)!r}), shared=shared):
            print("held")
    except BusyError:
        print("busy")
"""
    with locked(path) as lock:
        assert python("-c", other).stdout.split() == ["busy", "busy"]
        assert lock.take_alone()
    with locked(path, shared=True):
        assert python("-c", other).stdout.split() == ["held", "busy"]
    with locked(path, shared=True) as one, locked(path, shared=True) as two:
        assert not one.take_alone()
        assert two.take_alone()
    with locked(path) as lock:
        lock.remove()
    assert not path.exists()


def test_a_dataset_is_replaced_while_it_is_read_and_while_a_file_of_it_is_open(tiny, files):
    """Where a file is open, Windows may refuse; then the old dataset stays. Nothing is in the way later."""
    before = ibdata.generate(OTHER, "out", workers=1)
    assert len(before.table()) == 20
    assert ibdata.generate(TINY, "out", workers=1, overwrite=True).content_root == tiny[0].content_root
    with pytest.raises(BusyError, match="out: replaced while it was read; open it again"):
        before.table()
    refused = ""
    with next(Path("out/data").iterdir()).open("rb"):
        try:
            ibdata.generate(OTHER, "out", workers=1, overwrite=True)
        except IbdataError as error:
            refused = str(error)
        assert ibdata.open("out").content_root == tiny[not refused].content_root
        assert ibdata.validate("out") == []
    assert re.fullmatch("(out: cannot be written: refused by Windows, perhaps because .*)?", refused)
    ibdata.generate(TINY, "out", workers=1, overwrite=True)
    assert files("out") == files(tiny[0].path)
    assert list(Path().iterdir()) == [Path("out")]


@pytest.mark.slow
def test_what_is_made_of_datasets(tiny):
    """Splits, a merge, copies, exports and a repair."""
    merged = ibdata.merge([each.path for each in tiny], "merged")
    assert len(merged.episodes) == 8
    ibdata.split("merged", HALVES)
    ibdata.split("merged", HALVES, materialize="copies")
    assert ibdata.validate("merged") == ibdata.validate("copies") == []
    ibdata.export("merged", "csv", "out.csv")
    assert len(Path("out.csv").read_bytes().splitlines()) == 41
    damaged = next(Path("merged/data").iterdir())
    damaged.write_bytes(b"")
    assert ibdata.repair("merged", workers=1) == [f"data/{damaged.name}"]
    assert ibdata.validate("merged") == []


@pytest.mark.parametrize("place", ["a b/ünï→.x", "../up", f"{'long' * 40}/x"])
def test_a_place_may_have_any_name_that_the_system_allows(place, tmp_path, monkeypatch):
    Path("inner").mkdir()
    monkeypatch.chdir("inner")
    made = ibdata.generate(TINY, place, workers=1)
    assert sorted(path.name for path in Path(place).iterdir()) == ["README.md", "data", "meta"]
    assert ibdata.open(place).content_root == made.content_root
    assert not [path for path in contents(tmp_path) if ".part" in path]


@pytest.mark.parametrize("name", ["con", "AUX.x", "com1", "trail.", "trail ", "x/a:b", "what?", "a/nul/b"])
def test_names_that_windows_takes_for_others_are_refused_there(name, monkeypatch):
    monkeypatch.setattr(sys, "platform", "win32")
    with pytest.raises(UsageError, match="which is no name of a folder in Windows; choose another"):
        resolved(name)
    monkeypatch.undo()
    assert resolved("contents/.x/..a/a.b c/common").name == "common"
