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
ERRORS = {  # what is raised, what is seen, and its line
    "a full disk": (FULL, IbdataError, r"^a/b: cannot be written: No space left on device$"),
    "memory": (MemoryError(), IbdataError, r"^a/b: out of memory; use fewer --workers"),
    "a signal": (Interrupted(15), Interrupted, r"^stopped by signal 15; (2 shards are|nothing)"),
    "a bug": (ZeroDivisionError(), ZeroDivisionError, None),
}


@pytest.mark.parametrize(("error", "seen", "line"), ERRORS.values(), ids=ERRORS)
@pytest.mark.parametrize("shards", [0, 2])
def test_an_error_leaves_finished_shards_or_nothing(monkeypatch, files, tiny, error, seen, line, shards):
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
