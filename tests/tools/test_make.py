"""Shipped sets in one line: where they are kept, and what is trained and validated on.

The environments are tested where Gymnasium is installed, in tests/bridges/gymnasium/test_make.py.
"""

import shutil
import threading
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.refusals import refused

import ibdata
from ibdata._system.lock import locked
from ibdata.errors import BusyError, DatasetError
from ibdata.tools import make as room


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache, in which the canonical dataset of `random` has two short episodes at each setpoint."""

    def small(name, seed=None):
        return ibdata.load(name, {"steps": 4, "episodes": 2}, seed)

    monkeypatch.setattr(room, "cache_folders", lambda: SimpleNamespace(folders=(str(tmp_path / "cache"),)))
    monkeypatch.setattr(room, "load", small)
    root = ibdata.generate(small("random"), tmp_path / "elsewhere").content_root
    known = lambda name, experiment: root if experiment.seed == 0 else None  # noqa: E731
    monkeypatch.setattr(room, "canonical_root", known)
    monkeypatch.setattr(room, "_environment", lambda *given: "environment")
    return tmp_path / "cache/datasets"


def test_a_set_is_made_once_and_then_opened(cache, capsys):
    environment, train, validation = ibdata.make("random", history=3)
    line = "ibdata: random: trains at 10 … 100, validates at 10 … 100; setpoint= is the environment's alone"
    assert line in capsys.readouterr().err
    assert environment == "environment"
    assert (train["observations"].shape, validation["observations"].shape) == ((40, 18), (40, 18))
    made = (cache / "random/meta/manifest.json").stat()
    again = ibdata.make("random")
    assert again[1]["rewards"].tolist() == train["rewards"].tolist()
    assert (cache / "random/meta/manifest.json").stat().st_mtime_ns == made.st_mtime_ns
    _, other, _ = ibdata.make("random", seed=1)
    assert other["rewards"].tolist() != train["rewards"].tolist()
    assert sorted(path.name for path in cache.glob("[!.]*")) == ["random", "random-seed-1"]


def test_a_content_root_may_be_asked_for(cache, monkeypatch):
    root = room.canonical_root("random", ibdata.load("random"))
    refused(f"but the content root is {root}: leave @", ibdata.make, "random@000000")
    assert not cache.exists()  # nothing was made
    ibdata.make(f"random@{root[:6]}")
    refused("take the seed", ibdata.make, f"random@{root[:6]}", seed=1)
    monkeypatch.setattr(room, "canonical_root", lambda name, experiment: "0" * 64)
    with pytest.raises(DatasetError, match=f"random: found the content root {root}, expected 0000"):
        ibdata.make("random")


def test_the_canonical_roots_are_those_of_the_list():
    assert room.canonical_root("random", ibdata.load("random")).startswith("566ea3f2")
    assert room.canonical_root("random", ibdata.load("random", seed=1)) is None
    refused(r"found 'randm'; did you mean 'random'", ibdata.make, "randm")


def test_a_process_waits_for_another_that_makes_the_set(cache, monkeypatch):
    with ExitStack() as other:
        other.enter_context(locked(cache / ".random.lock"))
        with monkeypatch.context() as hasty:
            hasty.setattr(room, "PATIENCE", 0.0)
            refused("datasets/random: another process", ibdata.make, "random", error=BusyError)
        assert not (cache / "random").exists()
        of_other = other.pop_all()

        def finish():
            with of_other:
                ibdata.generate(room.load("random"), cache / "random")

        ending = threading.Timer(0.2, finish)
        ending.start()
        monkeypatch.setattr(room, "generate", None)  # whoever waited opens what the other one made
        _, train, _ = ibdata.make("random")
        ending.join()
    assert len(train["rewards"]) == 40


def flipped(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


DAMAGES = [
    ("data/*.parquet", flipped),
    ("meta/manifest.json", Path.unlink),
    ("meta/splits.json", Path.unlink),
    ("data", lambda path: (path / "x.parquet").write_text("")),
    ("", lambda path: (shutil.rmtree(path), path.write_text(""))),
    ("", lambda path: ibdata.generate(ibdata.load("random", {"steps": 3}), path, overwrite=True)),
]


def test_a_damaged_set_in_the_cache_is_made_again(cache):
    _, train, _ = ibdata.make("random")
    for where, damage in DAMAGES:
        damage(next(cache.glob(f"random/{where}".rstrip("/"))))
        _, again, _ = ibdata.make("random")
        assert np.array_equal(again["observations"], train["observations"])
    assert ibdata.validate(cache / "random") == []
    ibdata.generate(ibdata.load("random", {"steps": 3}, 1), cache / "random-seed-1")
    assert len(ibdata.make("random", seed=1)[1]["rewards"]) == 40


def test_the_declared_test_episodes_of_a_shipped_set_are_never_used(tmp_path):
    """Of `transfer`, 10 and 2 episodes are for training; of `depeweg`, 7 at each setpoint."""
    for name, train, validation in (("transfer", 10, 2), ("depeweg", 60, 10)):
        dataset = ibdata.generate(ibdata.load(name, {"steps": 2}), tmp_path / name)
        parts = room.train_and_validation(dataset)
        assert [int(part.inside.sum()) for part in parts] == [train, validation]
        assert not any((part.inside & dataset.select("test").inside).any() for part in parts)
        points = [np.unique(part.episode_table["setpoint"]).tolist() for part in parts]
        assert points[0] == points[1] == np.unique(dataset.episodes["setpoint"]).tolist()


TWO = {"setpoints": [20.0, 70.0]}
LAST_AT_70 = {"test": {"setpoint": 70, "episodes": {"start": 1, "stop": 2}}}
HALVES = {"train": {"episodes": "first 50%"}, "test": {"episodes": "last 50%"}}
PARTS = [
    ({**TWO, "episodes": 3}, [0, 1, 3, 4], [2, 5]),
    ({**TWO, "episodes": 1}, [0], [1]),
    ({**TWO, "episodes": 1, "policies": ["random", "safe"]}, [0, 1], [2, 3]),
    ({"episodes": 2, "policies": ["random", "safe"]}, [0, 2], [1, 3]),
    ({**TWO, "episodes": 3, "splits": LAST_AT_70}, [0, 1, 3], [2]),
    ({**TWO, "episodes": 20}, [*range(18), *range(20, 38)], [18, 19, 38, 39]),
    ({"episodes": 20, "splits": HALVES}, range(9), [9]),
    ({"episodes": 5, "splits": {"validation": {"episodes": "last 60%"}}}, [0, 1], [2, 3, 4]),
]


@pytest.mark.parametrize(("changes", "train", "validation"), PARTS)
def test_episodes_to_train_and_to_validate_on(describe, tmp_path, changes, train, validation):
    usual = {"setpoints": 70.0, "steps": 2, "policies": ["random"], "splits": {}}
    dataset = ibdata.generate(describe(**{**usual, **changes}), tmp_path / "made")
    parts = room.train_and_validation(dataset)
    assert [np.flatnonzero(part.inside).tolist() for part in parts] == [list(train), list(validation)]
