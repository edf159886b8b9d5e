"""Locks of writers: one at a time, and none where the file system has no locks."""

import errno
import fcntl
import os
import shutil
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

import pytest
from helpers.datasets import FOUR_SHARDS as TINY
from helpers.folders import contents

import ibdata
from ibdata._system import part as parts
from ibdata._system.part import locked_part
from ibdata.errors import BusyError, IbdataError
from ibdata.tools.card import card
from ibdata.tools.split_schemes import leave_one_out

OTHER = TINY.model_copy(update={"seed": 1})
WRITERS = {
    "generate": lambda: ibdata.generate(TINY, "new", workers=1),
    "shards": lambda: ibdata.generate(TINY, "new", shards="1/2", workers=1),
    "merge": lambda: ibdata.merge(["a", "b"], "new"),
    "materialize": lambda: ibdata.split("a", leave_one_out(ibdata.open("a")), materialize="new"),
    "split": lambda: ibdata.split("a", leave_one_out(ibdata.open("a"))),
    "card": lambda: card("a"),
    "export": lambda: ibdata.export("a", "npz", "new"),
    "repair": lambda: ibdata.repair("c", workers=1),
    "replace": lambda: ibdata.generate(OTHER, "a", workers=1, overwrite=True),
}


@pytest.fixture(autouse=True)
def _beside_two_datasets(tiny, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, path in zip("abc", [tiny[0].path, tiny[1].path, tiny[0].path], strict=True):
        shutil.copytree(path, name)
    next(Path("c/data").iterdir()).write_bytes(b"")  # for `repair`
    monkeypatch.setattr(parts, "PATIENCE", 0.05)
    monkeypatch.setitem(sys.modules, "matplotlib", None)  # pictures of a card take seconds


def test_a_second_writer_is_refused():
    with ExitStack() as held:
        for name in ("new", "a", "c"):
            held.enter_context(locked_part(Path(name).absolute()))
        before = contents()
        for write in WRITERS.values():
            with pytest.raises(BusyError, match=r"(new|a|c): another process is writing here; wait") as error:
                write()
            assert (error.value.exit_code, contents()) == (75, before)
    WRITERS["generate"]()


def test_without_locks_nothing_is_written_but_a_dataset_is_read(monkeypatch):
    def flock(descriptor, operation):
        raise OSError(errno.EOPNOTSUPP, os.strerror(errno.EOPNOTSUPP))

    before = contents()
    monkeypatch.setattr(fcntl, "flock", flock)
    for name in ("generate", "split"):
        with pytest.raises(IbdataError, match=r"the file system has no locks \(.*\); choose a fo"):
            WRITERS[name]()
    assert contents() == before
    assert ibdata.validate("b") == ibdata.reproduce("b")[1] == []
    assert ibdata.generate(OTHER, "b", workers=1).place == "b"


def test_of_several_threads_one_at_a_time_has_the_lock():
    """However often the lock's file is removed and made again."""
    place, inside, together = Path("new").absolute(), [], []

    def once(name):
        try:
            with locked_part(place):
                inside.append(name)
                together.append(len(inside))
                time.sleep(0.0005)
                inside.remove(name)
                return True
        except BusyError:
            time.sleep(0.0005)
            return False

    def run(name):
        for _ in range(20):
            while not once(name):
                pass

    with ThreadPoolExecutor(4) as threads:
        list(threads.map(run, range(4)))
    assert together == [1] * 80
    assert not Path(".new.part").exists()
