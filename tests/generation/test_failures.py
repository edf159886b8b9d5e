"""A failed or interrupted run says so in one line, and leaves shards to go on with, or nothing."""

from __future__ import annotations

import signal
import threading
import time
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from helpers.folders import contents, is_right, part_of, receipts
from helpers.tiny import FOUR_SHARDS as TINY

import ibdata
from ibdata import IbdataError
from ibdata.errors import Interrupted, PolicyError
from ibdata.generation import make_shard
from ibdata.policies import Decision, Needs


@pytest.fixture(autouse=True)
def _one_processor(monkeypatch):
    monkeypatch.setattr("ibdata.generation.workers.available_processors", lambda: 1)  # shards in order


def failing_at(call, error, function=None):
    """A function that does what another does, up to its call of that number."""
    calls = iter(range(10**6))

    def wrapped(*args, **options):
        if next(calls) >= call:
            raise error
        return function(*args, **options)

    return wrapped


PLACES = {  # a function, the number of the call that fails, and how many shards are finished then
    "third shard": ("ibdata.generation.make_shard.shard_writer", 2, 2),
    "metadata": ("ibdata.generation.run.finish", 0, 4),
    "publishing": ("ibdata.generation.publish.sync_folder", 0, 4),
    "sync of the run": ("os.fsync", 1, 0),
}


@pytest.mark.parametrize(("place", "call", "shards"), PLACES.values(), ids=PLACES)
def test_a_full_disk_leaves_finished_shards_or_nothing(monkeypatch, files, tiny, place, call, shards):
    """Wherever the system refuses, one line says why, and --resume makes the same dataset."""
    if call == 1:  # an empty folder is a place too
        Path("a/b").mkdir(parents=True)
    before = contents()
    module, _, name = place.rpartition(".")
    real = getattr(import_module(module), name)
    with monkeypatch.context() as full:
        full.setattr(place, failing_at(call, OSError(28, "No space left on device"), real))
        with pytest.raises(IbdataError, match=r"^a/b: cannot be written: No space left on device$") as error:
            ibdata.generate(TINY, "a/b", workers=1)
    assert error.value.exit_code == 1
    assert len(receipts("a/b")) == shards
    assert contents() == before or receipts("a/b")
    ibdata.generate(TINY, "a/b", workers=1, resume=True)
    assert is_right("a/b", tiny[0].path, files)


@pytest.mark.parametrize(
    ("error", "seen"),
    [(KeyboardInterrupt, KeyboardInterrupt), (MemoryError, IbdataError), (ZeroDivisionError,) * 2],
)
@pytest.mark.parametrize("shards", [0, 2])
def test_any_exception_leaves_finished_shards_or_nothing(monkeypatch, tmp_path, error, seen, shards):
    """Exceptions other than the system's pass as they are, but for a lack of memory."""
    real = make_shard.shard_writer
    monkeypatch.setattr("ibdata.generation.make_shard.shard_writer", failing_at(shards, error, real))
    with pytest.raises(seen):
        ibdata.generate(TINY, "a/b", workers=1)
    assert len(receipts("a/b")) == shards
    assert bool(contents()) == bool(shards)


def test_a_shard_that_fails_does_not_wait_for_others(monkeypatch):
    """Where several threads make shards, the error of one ends the others between two pieces."""
    monkeypatch.setattr("ibdata.generation.workers.available_processors", lambda: 4)
    started, simulated = threading.Barrier(4, timeout=20), make_shard.simulated

    def failing(spec, shard, *rest):
        started.wait()  # until each of the four has its thread
        if shard.number == 2:
            raise OSError(28, "No space left on device")
        for made in simulated(spec, shard, *rest):
            time.sleep(0.3)  # until the other thread has failed
            yield made

    monkeypatch.setattr(make_shard, "simulated", failing)
    with pytest.raises(IbdataError, match="No space left on device"):
        ibdata.generate(TINY, "out")
    assert not [each for each in threading.enumerate() if "ThreadPool" in each.name]
    assert contents() == {}


# --- policies


def test_a_failing_policy_is_named_with_its_step(monkeypatch):
    """An action that is not a number ends the run at its episode and step; earlier shards stay."""
    calls = iter(range(1000))

    def decide(self, given):
        action = 2.0 * given.uniforms - 1.0
        action[:, 1] = np.nan if next(calls) >= 2 + 5 + 3 else 0.0  # two steps to warm up, then five a shard
        return Decision(action, given.memory)

    monkeypatch.setattr("ibdata.policies.random.Random.needs", Needs(history=1, step_draws=3))
    monkeypatch.setattr("ibdata.policies.random.Random.decide", decide)
    monkeypatch.setattr("ibdata.experiment.self_check.answer", lambda: "0" * 64)  # it plays this policy too
    with pytest.raises(PolicyError, match=r"^policy random: episode 1: step 3: found action \[.* nan "):
        ibdata.generate(TINY, "a/b", workers=1)
    assert receipts("a/b") == ["00000.npy"]


# --- signals


@pytest.fixture
def signalled(monkeypatch):
    """Let a signal arrive while the shard of a number is made."""

    def arrange(number, at):
        simulated = make_shard.simulated

        def sending(spec, shard, *rest):
            if shard.number == at:
                signal.pthread_kill(threading.main_thread().ident, number)
                time.sleep(0.5)  # the main thread looks five times a second
            yield from simulated(spec, shard, *rest)

        monkeypatch.setattr(make_shard, "simulated", sending)

    return arrange


@pytest.mark.parametrize(
    ("number", "at", "left"),
    [
        (signal.SIGINT, 0, "nothing unfinished is left behind"),
        (signal.SIGTERM, 1, "1 shard is finished; --resume goes on"),
        (signal.SIGHUP, 2, "2 shards are finished; --resume goes on"),
    ],
)
def test_a_signal_ends_a_loop_over_experiments(signalled, number, at, left):
    """`except Exception` around each run does not swallow a signal, which says what is left behind."""
    signalled(number, at)
    tried = []

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
    assert isinstance(stopped.value, KeyboardInterrupt)
    assert stopped.value.exit_code == 128 + number
    assert str(stopped.value) == f"stopped by signal {int(number)}; {left}"
    assert (len(receipts("a")), part_of("a").exists()) == (at, at > 0)
