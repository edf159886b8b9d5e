"""Locks: file systems without locks, and ranges that share shards."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import shutil
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import pytest
from helpers.tiny import TEN_SHARDS
from ibdata.generation.ranges import Range
from ibdata.system.guard import refusals

import ibdata
from ibdata import IbdataError
from ibdata.errors import BusyError, UsageError
from ibdata.experiment.plan import plan
from ibdata.generation import ranges, receipt
from ibdata.system import lock

TINY = TEN_SHARDS
SHARDS = plan(TINY)


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


# --- no locks


@pytest.fixture(params=[errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOLCK], ids=errno.errorcode.get)
def no_locks(request, monkeypatch):
    """Let every lock fail, from when it is called."""

    def flock(descriptor, operation):
        raise OSError(request.param, os.strerror(request.param))

    return lambda: monkeypatch.setattr(fcntl, "flock", flock)


REFUSAL = r"^{}: the file system has no locks \(.*\); choose a folder "
WRITERS = {
    "generate": lambda: ibdata.generate(TINY, "new/er", workers=1),
    "shards": lambda: ibdata.generate_shards(TINY, "1/2", "new/er", workers=1),
    "merge": lambda: ibdata.merge(["d", "other"], "new/er"),
    "materialize": lambda: ibdata.split("d", scheme="leave-one-out", materialize="new/er"),
}


@pytest.mark.slow
@pytest.mark.parametrize("writer", WRITERS)
def test_without_locks_nothing_is_written_and_the_line_says_why(no_locks, writer):
    for seed, name in enumerate(["d", "other"]):
        ibdata.generate(TINY, name, seed=seed, workers=1)
    no_locks()
    with pytest.raises(IbdataError, match=REFUSAL.format("new/er")) as error:
        WRITERS[writer]()
    assert error.value.exit_code == 1
    assert "\n" not in str(error.value)
    assert sorted(os.listdir()) == ["d", "other"]


def test_without_locks_what_is_there_is_read_and_not_changed(no_locks):
    made = ibdata.generate(TINY, "d", workers=1)
    shutil.copytree("d", "stale")
    Path("stale/.lock").touch()
    before = sorted(Path("stale").rglob("*"))
    no_locks()
    for folder in ("d", "stale"):
        assert ibdata.validate(folder) == []
        assert ibdata.open(folder).to_pandas().equals(made.to_pandas())
        assert ibdata.reproduce(folder)[1] == []
        writers = (
            lambda folder=folder: ibdata.repair(folder, workers=1),
            lambda folder=folder: ibdata.split(folder, scheme="leave-one-out"),
            lambda folder=folder: ibdata.generate(TINY, folder, seed=1, overwrite=True, workers=1),
            lambda folder=folder: ibdata.generate_shards(TINY, "1/1", folder, workers=1),
        )
        for write in writers:
            with pytest.raises(IbdataError, match=REFUSAL.format(folder)):
                write()
    assert sorted(Path("stale").rglob("*")) == before
    assert not Path("d/.lock").exists()


# --- ranges


@pytest.mark.parametrize("other", ["1/1", "1/2", "2/3", "3/10", "4/10"])
def test_ranges_that_share_a_shard_exclude_each_other(other):
    Path("out").mkdir()
    held, wanted = Range.parse("1/2"), Range.parse(other)
    with ranges.locked(Path("out"), held, SHARDS):
        expected = rf"^out: the part 1/2 is being made, which has shards in common with the part {other}; "
        with pytest.raises(BusyError, match=expected):
            ranges.refuse_shared(Path("out"), wanted, SHARDS)
        with pytest.raises(BusyError, match=expected):
            ibdata.generate_shards(TINY, other, "out", workers=1)
    assert os.listdir("out") == []
    with ranges.locked(Path("out"), wanted, SHARDS):
        assert os.listdir("out") == [f".lock-{wanted.part}-{wanted.parts}"]


@pytest.mark.parametrize(("other", "third"), [("2/2", "1/20"), ("3/3", "6/10"), ("6/10", "3/3")])
def test_ranges_without_a_shard_in_common_are_held_together(other, third):
    Path("out").mkdir()
    for name in (".lock-1-1", ".lock-9-2", ".lock-x-y", ".lock-gate"):
        Path("out", name).touch()  # of killed ones, and names that are none
    with (
        ranges.locked(Path("out"), Range.parse("1/2"), SHARDS),
        ranges.locked(Path("out"), Range.parse(other), SHARDS),
    ):
        made = ibdata.generate_shards(TINY, third, "out", workers=1)
    assert made.shards == len(Range.parse(third).of(SHARDS))


def test_of_threads_that_want_the_same_shards_one_at_a_time_has_them():
    Path("out").mkdir()
    together = Barrier(6)
    inside, together_inside = [], []

    def run(text):
        together.wait()
        done = False
        while not done:
            try:
                with ranges.locked(Path("out"), Range.parse(text), SHARDS):
                    inside.append(text)
                    together_inside.append(list(inside))
                    time.sleep(0.01)
                    inside.remove(text)
                    done = True
            except BusyError:
                time.sleep(0.001)

    with ThreadPoolExecutor(6) as threads:
        list(threads.map(run, ["1/1", "1/2", "1/3", "2/4", "1/10", "2/10"]))
    assert len(together_inside) == 6
    for texts in together_inside:
        held = [shard for text in texts for shard in Range.parse(text).of(SHARDS)]
        assert len(held) == len(set(held))


MANY = {**TEN_SHARDS.plain(), "name": "many", "episodes": 40, "steps": 1000, "output": {"shard_rows": 1000}}


@pytest.fixture
def start(start):
    """As everywhere, beside the experiment."""
    Path("many.yaml").write_text(json.dumps(MANY))
    return start


def has_begun(process):
    """Wait until the process has made a shard."""
    first = Path("out", receipt.path_of(plan(ibdata.load("many.yaml"))[0]))
    deadline = time.monotonic() + 120
    while not first.exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.002)
    assert first.exists(), process.communicate()


@pytest.mark.slow
def test_an_overlapping_process_is_refused_and_after_a_kill_any_range_goes_on(start):
    whole = start("1/1")
    has_begun(whole)
    whole.send_signal(signal.SIGSTOP)  # so that it is there, whatever the machine does meanwhile
    for text in ("1/2", "2/2", "80/80"):
        second = start(text)
        out, err = second.communicate(timeout=120)
        assert (second.returncode, out, err.count("\n")) == (75, "", 1), err
        assert f"the part 1/1 is being made, which has shards in common with the part {text}" in err
    whole.send_signal(signal.SIGKILL)
    whole.wait()
    halves = [start("1/2"), start("2/2")]
    said = [half.communicate(timeout=200) for half in halves]
    assert [half.returncode for half in halves] == [0, 0], said
    root = ibdata.finalize("out").content_root
    assert root == ibdata.generate("many.yaml", "plain", workers=1).content_root
    assert sorted(os.listdir("out")) == sorted(os.listdir("plain"))


@pytest.mark.slow
def test_of_overlapping_processes_that_start_together_no_work_is_lost(start):
    runs = [start(text) for text in ("1/2", "1/1", "2/2")]
    said = [run.communicate(timeout=200) for run in runs]
    codes = [run.returncode for run in runs]
    assert set(codes) <= {0, 75}, said
    assert 0 in codes, said
    again = start("1/1")
    assert (again.wait(), again.communicate()[1]) == (0, "")
    assert ibdata.validate(ibdata.finalize("out").path) == []


def test_a_lock_that_is_asked_after_is_not_taken():
    Path("out").mkdir()
    path = Path("out/.lock-1-1")
    path.touch()
    assert not lock.held(path)
    with lock.locked(Path("out"), path.name):
        assert lock.held(path)
    assert not lock.held(path)
    assert not path.exists()


def test_files_of_a_user_with_names_like_ours_stay():
    ibdata.generate_shards(TINY, "1/2", "out", workers=1)
    last = f"part-{SHARDS[-1].number:05d}"
    for name in (".lock-mine", f"data/{last}-mine.parquet.bak", f"data/{last}-mine.parquet"):
        Path("out", name).write_text("mine")
    Path("out/.lock-9-9").touch()
    with pytest.raises(UsageError, match=r"mine\.parquet: found something that is not the dataset's"):
        ibdata.generate(TINY, "out", workers=1, resume=True)
    for path in Path("out/data").glob("*mine*"):
        assert path.read_text() == "mine"
        path.unlink()
    ibdata.generate(TINY, "out", workers=1, resume=True)
    assert Path("out/.lock-mine").read_text() == "mine"
    assert not Path("out/.lock-9-9").exists()


def test_a_limit_of_threads_is_a_refusal_of_the_system():
    with pytest.raises(IbdataError, match="out: the system starts no more threads"), refusals(Path("out")):
        raise RuntimeError("can't start new thread")
    with pytest.raises(RuntimeError, match="else"), refusals(Path("out")):
        raise RuntimeError("something else")
