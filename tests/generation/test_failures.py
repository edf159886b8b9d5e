"""A failed run prints one line, and leaves only files that can be resumed."""

from __future__ import annotations

import json
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from helpers.tiny import FOUR_SHARDS

import ibdata
from ibdata import IbdataError
from ibdata.errors import ConfigError
from ibdata.policies.checked import PolicyError


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("ibdata.generation.division.available_processors", lambda: 1)  # shards in order


@pytest.fixture
def tiny():
    return FOUR_SHARDS


def contents(folder):
    """Every file and folder below a folder, with the bytes of the files."""
    paths = sorted(Path(folder).rglob("*"))
    return {str(path): None if path.is_dir() else path.read_bytes() for path in paths}


def failing_at(call, error):
    """A function that does what another does until its call of that number."""

    def wrap(function):
        calls = iter(range(10**6))

        def wrapped(*args, **options):
            if next(calls) == call:
                raise error
            return function(*args, **options)

        return wrapped

    return wrap


PLACES = [
    ("ibdata.generation.generate.finish", 0),
    ("ibdata.writing.finish.write", 0),
    ("ibdata.writing.finish.write", 5),
    ("ibdata.generation.make_shard.shard_writer", 2),
    ("ibdata.writing.shard_writer.arrow_table", 0),
    ("ibdata.writing.shard_writer.ShardSummarizer", 3),
    ("os.fsync", 1),
    ("os.fsync", 9),
]


def assert_resumable_or_nothing(before, tiny, monkeypatch):
    """What is left: nothing new, or shards with receipts, from which the same dataset comes out."""
    left = contents(".")
    assert not [path for path in left if ".tmp-" in path or ".lock" in path or path.endswith("manifest.json")]
    if left == before:
        return False
    receipts = [path for path in left if path.endswith(".receipt")]
    assert receipts
    assert [path for path in left if path.endswith(".parquet")]
    monkeypatch.undo()
    resumed = ibdata.generate(tiny, "a/b", workers=1, resume=True)
    assert resumed.content_root == ibdata.generate(tiny, "whole", workers=1).content_root
    assert not Path("a/b/.run").exists()
    return True


@pytest.mark.parametrize("existing", [False, True])
@pytest.mark.parametrize(("place", "call"), PLACES)
def test_a_failed_run_leaves_what_can_be_resumed_or_nothing(
    monkeypatch, tmp_path, tiny, place, call, existing
):
    if existing:
        Path("a/b").mkdir(parents=True)
    before = contents(".")
    module, _, name = place.rpartition(".")
    original = getattr(import_module(module), name)
    monkeypatch.setattr(place, failing_at(call, OSError(28, "No space left on device"))(original))
    with pytest.raises(IbdataError) as error:
        ibdata.generate(tiny, "a/b", workers=1)
    assert str(error.value) == "a/b: cannot be written: No space left on device"
    assert error.value.exit_code == 1
    left = assert_resumable_or_nothing(before, tiny, _Folder(monkeypatch, tmp_path))
    assert left == (place.endswith("finish") or ".finish." in place or call > 1)


class _Folder:
    """Undoes the patches but stays in the folder of the test."""

    def __init__(self, monkeypatch, folder):
        self.monkeypatch, self.folder = monkeypatch, folder

    def undo(self):
        self.monkeypatch.undo()
        self.monkeypatch.chdir(self.folder)


@pytest.mark.parametrize(
    ("error", "seen"),
    [
        (KeyboardInterrupt, KeyboardInterrupt),
        (MemoryError, IbdataError),
        (ZeroDivisionError, ZeroDivisionError),
    ],
)
def test_other_exceptions_pass_and_leave_what_can_be_resumed(monkeypatch, tmp_path, tiny, error, seen):
    monkeypatch.setattr("ibdata.generation.generate.finish", failing_at(0, error)(None))
    with pytest.raises(seen):
        ibdata.generate(tiny, "a/b", workers=1)
    assert assert_resumable_or_nothing({}, tiny, _Folder(monkeypatch, tmp_path))


def test_a_policy_that_switches_denormal_numbers_off_during_a_run_ends_it(monkeypatch, tiny):
    answers = iter([True, True, True, False])  # before and after each shard
    monkeypatch.setattr("ibdata.writing.summary.keeps_denormals", lambda: next(answers))
    found = r"^data/part-00001: a policy switched denormal numbers off in the middle"
    with pytest.raises(IbdataError, match=found):
        ibdata.generate(tiny, "a/b", workers=1)
    monkeypatch.undo()


def test_a_failing_policy_is_an_error_and_leaves_the_shards_before_it(monkeypatch, tiny, shard_file):
    """After the first run, which warms up, the second shard's policy fails at step 3."""
    calls = iter(range(1000))

    def act(self, history, u):
        action = 2.0 * u - 1.0
        action[:, 1] = np.nan if next(calls) == 2 + 5 + 3 else 0.0
        return action

    monkeypatch.setattr("ibdata.policies.random.Random.history_length", 1)
    monkeypatch.setattr("ibdata.policies.random.Random.act", act)
    monkeypatch.setattr("ibdata.simulation.self_check.answer", lambda: "0" * 64)  # it plays this policy too
    with pytest.raises(PolicyError, match=r"^policy random: episode 1: step 3: found action \[.* nan "):
        ibdata.generate(tiny, "a/b", workers=1)
    assert [Path(path).name for path in contents(".") if "part-" in path] == [
        "part-00000.receipt",
        Path(shard_file("a/b", 0)).name,
    ]


def test_a_config_with_errors_makes_nothing():
    Path("bad.yaml").write_text(json.dumps({**FOUR_SHARDS.plain(), "steps": 0}))
    with pytest.raises(ConfigError, match=r"^bad\.yaml:1:"):
        ibdata.generate("bad.yaml", workers=1)
    assert list(contents(".")) == ["bad.yaml"]
