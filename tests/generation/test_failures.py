"""A failed or interrupted run says so in one line, and leaves shards to go on with, or nothing."""

import pytest
from helpers.datasets import FOUR_SHARDS as TINY
from helpers.folders import contents, is_right, receipts

import ibdata
from ibdata import IbdataError
from ibdata.errors import Interrupted
from ibdata.generation import workers


@pytest.fixture(autouse=True)
def _one_processor(monkeypatch):
    monkeypatch.setattr("ibdata.generation.workers.available_processors", lambda: 1)  # shards in order


FULL = OSError(28, "No space left on device")
ERRORS = {  # after how many shards what is raised, what is seen, and its line
    "a full disk": (0, FULL, IbdataError, r"^a/b: cannot be written: No space left on device$"),
    "memory": (2, MemoryError(), IbdataError, r"^a/b: out of memory; use fewer --workers"),
    "a signal": (2, Interrupted(15), Interrupted, r"^stopped by signal 15; 2 shards are"),
    "an early signal": (0, Interrupted(15), Interrupted, r"^stopped by signal 15; nothing"),
    "a bug": (2, ZeroDivisionError(), ZeroDivisionError, None),
}


@pytest.mark.parametrize(("shards", "error", "seen", "line"), ERRORS.values(), ids=ERRORS)
def test_an_error_leaves_finished_shards_or_nothing(monkeypatch, files, tiny, shards, error, seen, line):
    """tests/life and tests/faults raise errors of the system at any operation."""
    real, calls = workers.write_shard, iter(range(9))

    def failing(*args):
        if next(calls) >= shards:
            raise error
        return real(*args)

    with monkeypatch.context() as patched:
        patched.setattr(workers, "write_shard", failing)
        with pytest.raises(seen, match=line):
            ibdata.generate(TINY, "a/b", workers=1)
    assert len(receipts("a/b")) == shards
    assert bool(contents()) == bool(shards)
    ibdata.generate(TINY, "a/b", workers=1)
    assert is_right("a/b", tiny[0].path, files)
