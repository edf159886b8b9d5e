"""A failed or interrupted run says so in one line, and leaves shards to go on with, or nothing."""

import signal
import threading
import time

import pytest
from helpers.folders import contents, is_right, part_of, receipts
from helpers.tiny import FOUR_SHARDS as TINY

import ibdata
from ibdata import IbdataError
from ibdata.errors import Interrupted
from ibdata.generation import make_shard


@pytest.fixture(autouse=True)
def _one_processor(monkeypatch):
    monkeypatch.setattr("ibdata.generation.workers.available_processors", lambda: 1)  # shards in order


FULL = OSError(28, "No space left on device")
ERRORS = {  # what is raised, what is seen, and its line
    "a full disk": (FULL, IbdataError, r"^a/b: cannot be written: No space left on device$"),
    "memory": (MemoryError(), IbdataError, r"^a/b: out of memory; use fewer --workers"),
    "Ctrl-C": (KeyboardInterrupt(), KeyboardInterrupt, None),
    "a bug": (ZeroDivisionError(), ZeroDivisionError, None),
}


@pytest.mark.parametrize(("error", "seen", "line"), ERRORS.values(), ids=ERRORS)
@pytest.mark.parametrize("shards", [0, 2])
def test_an_error_leaves_finished_shards_or_nothing(monkeypatch, files, tiny, error, seen, line, shards):
    """tests/life and tests/faults raise errors of the system at any operation."""
    real, calls = make_shard.shard_writer, iter(range(9))

    def failing(*args):
        if next(calls) >= shards:
            raise error
        return real(*args)

    with monkeypatch.context() as patched:
        patched.setattr(make_shard, "shard_writer", failing)
        with pytest.raises(seen, match=line):
            ibdata.generate(TINY, "a/b", workers=1)
    assert len(receipts("a/b")) == shards
    assert bool(contents()) == bool(shards)
    ibdata.generate(TINY, "a/b", workers=1, resume=True)
    assert is_right("a/b", tiny[0].path, files)


@pytest.mark.parametrize(
    ("number", "at", "left"),
    [
        (signal.SIGINT, 0, "nothing unfinished is left behind"),
        (signal.SIGTERM, 1, "1 shard is finished; --resume goes on"),
        (signal.SIGHUP, 2, "2 shards are finished; --resume goes on"),
    ],
)
def test_a_signal_ends_a_loop_over_experiments(monkeypatch, number, at, left):
    """`except Exception` around each run does not swallow it, and it says what is left behind."""
    simulated, tried = make_shard.simulated, []

    def sending(spec, shard, *rest):
        if shard.number == at:
            signal.pthread_kill(threading.main_thread().ident, number)
            time.sleep(0.5)  # the main thread looks five times a second
        yield from simulated(spec, shard, *rest)

    monkeypatch.setattr(make_shard, "simulated", sending)

    def loop():
        for name in ("a", "b"):
            tried.append(name)
            try:
                ibdata.generate(TINY, name, workers=1)
            except Exception:
                continue

    with pytest.raises(Interrupted) as stopped:
        loop()
    assert tried == ["a"]
    assert stopped.value.exit_code == 128 + number
    assert str(stopped.value) == f"stopped by signal {int(number)}; {left}"
    assert (len(receipts("a")), part_of("a").exists()) == (at, at > 0)
