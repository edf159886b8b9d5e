"""The estimate of a run is close to the run, and leaves no files."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

import ibdata
from ibdata import Experiment
from ibdata.errors import UsageError
from ibdata.experiment import as_yaml
from ibdata.generation.estimate import estimate, preview


def described(**changes):
    plain = {
        "name": "guessed",
        "setpoints": [20.0, 70.0],
        "policies": [{"kind": "random"}],
        "episodes": 25,
        "steps": 1000,
    }
    return Experiment.model_validate({**plain, **changes})


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def parquet_bytes(dataset):
    return sum(path.stat().st_size for path in (dataset.path / "data").iterdir())


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"output": {"shard_rows": 5000, "dtype": "float64"}},
        {"policies": [{"kind": "constant"}, {"kind": "safe"}], "output": {"latent": "full"}},
        {"setpoints": {"drifting": [10, 50, 90]}, "steps": 7, "episodes": 800, "start": "uniform"},
    ],
    ids=["plain", "shards", "full", "short"],
)
def test_the_bytes_are_within_a_tenth_of_those_made(changes):
    experiment = described(**changes)
    guessed = estimate(experiment, Path("made"), workers=1)
    made = ibdata.generate(experiment, "made", workers=1)
    assert guessed["bytes"] == pytest.approx(parquet_bytes(made), rel=0.1)
    counts = made.info["counts"]
    assert {name: guessed[name] for name in ("rows", "episodes", "shards")} == {
        name: counts[name] for name in ("rows", "episodes", "shards")
    }


def test_a_sample_of_a_larger_run_speaks_for_all_its_policies():
    """Constant actions take half of the bytes of random ones, and come first."""
    experiment = described(policies=[{"kind": "constant"}, {"kind": "random"}], episodes=110)
    guessed = estimate(experiment, Path("made"), workers=1)
    made = ibdata.generate(experiment, "made", workers=1)
    assert guessed["bytes"] == pytest.approx(parquet_bytes(made), rel=0.2)


def test_an_estimate_says_where_and_with_how_many_workers():
    guessed = estimate(described(output={"shard_rows": 20_000}), Path("data/guessed"), workers=2)
    assert list(guessed) == ["out", "episodes", "rows", "shards", "bytes", "seconds", "workers"]
    assert (guessed["out"], guessed["workers"], guessed["shards"]) == ("data/guessed", 2, 3)
    assert estimate(described(), Path("data/guessed"), workers=2)["workers"] == 1
    assert 0.0 < guessed["seconds"] < 60.0


def test_a_huge_run_is_estimated_at_once():
    start = time.perf_counter()
    guessed = estimate(described(episodes=10**9, output={"shard_rows": 10**8}), Path("x"), workers=1)
    assert time.perf_counter() - start < 20.0
    assert guessed["rows"] == 2 * 10**12
    assert guessed["bytes"] > 10**13


def test_nothing_is_written():
    estimate(described(episodes=1), Path("a/b"), workers=1)
    Path("empty").mkdir()
    estimate(described(episodes=1), Path("empty"), workers=1)
    assert [str(path) for path in Path().rglob("*")] == ["empty"]


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"workers": 0}, "workers: found 0, expected"),
        ({"workers": 10**6}, "workers: found 1000000, expected"),
        ({"folder": Path("file")}, "file: is a file, not a folder"),
        ({"folder": Path("made")}, "made: exists already"),
        ({"folder": Path("foreign")}, "foreign: exists already"),
        ({"folder": Path("foreign"), "overwrite": True}, "foreign: not a dataset of ibdata"),
    ],
    ids=str,
)
def test_what_generating_refuses_is_refused(options, line):
    Path("file").write_text("mine")
    Path("foreign").mkdir()
    Path("foreign/mine").write_text("mine")
    experiment = described(episodes=1, steps=2)
    made = ibdata.generate(experiment, "made", workers=1)
    with pytest.raises(UsageError) as error:
        estimate(experiment, **{"folder": Path("new"), "workers": 1, **options})
    assert str(error.value).startswith(line)
    assert ibdata.open("made").content_root == made.content_root


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"folder": Path("new")}, None),
        ({"folder": Path("empty")}, None),
        (
            {},
            "generate would stop with: made: exists already; choose another --out, or --overwrite to replace "
            "a dataset",
        ),
        ({"overwrite": True}, "exists; generate would replace the dataset in it"),
        ({"resume": True}, "exists; generate would find the dataset finished, and write nothing"),
        (
            {"folder": Path("foreign")},
            "generate would stop with: foreign: exists already; choose another --out",
        ),
        ({"folder": Path("begun")}, "generate would stop with: begun: holds an unfinished run; --resume"),
        (
            {"folder": Path("begun"), "resume": True},
            "exists; generate would go on with the unfinished run in it",
        ),
        (
            {"folder": Path("begun"), "overwrite": True},
            "exists; generate would discard the unfinished run in it",
        ),
    ],
    ids=str,
)
def test_a_preview_says_what_would_become_of_a_folder_that_exists(options, said):
    experiment = described(episodes=1, steps=2)
    ibdata.generate(experiment, "made", workers=1)
    for path, content in (("foreign/mine", b"mine"), ("begun/.run/experiment.yaml", as_yaml(experiment))):
        Path(path).parent.mkdir(parents=True)
        Path(path).write_bytes(content)
    Path("empty").mkdir()
    before = {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}
    made = preview(experiment, **{"folder": Path("made"), "workers": 1, **options})
    assert made["rows"] == experiment.rows
    assert made["folder"] == said if said is None else made["folder"].startswith(said)
    assert {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()} == before


def test_a_preview_refuses_a_place_where_no_option_helps():
    Path("file").write_text("mine")
    Path("foreign").mkdir()
    Path("foreign/mine").write_text("mine")
    with pytest.raises(UsageError, match="is a file, not a folder"):
        preview(described(episodes=1), Path("file"))
    with pytest.raises(UsageError, match="not a dataset of ibdata"):
        preview(described(episodes=1), Path("foreign"), overwrite=True)


def test_a_dataset_that_may_be_overwritten_is_estimated_and_stays():
    experiment = described(episodes=1, steps=2)
    made = ibdata.generate(experiment, "made", workers=1)
    before = {path: path.read_bytes() for path in made.path.rglob("*") if path.is_file()}
    estimate(experiment, Path("made"), workers=1, overwrite=True)
    assert {path: path.read_bytes() for path in made.path.rglob("*") if path.is_file()} == before
