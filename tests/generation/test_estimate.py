"""The estimate of a run is close to the run, and leaves no files."""

from pathlib import Path

import pytest

import ibdata
from ibdata import Experiment
from ibdata.errors import UsageError
from ibdata.generation.estimate import estimate


def described(**changes):
    plain = {"name": "guessed", "setpoints": [20.0, 70.0], "policies": ["random"], "episodes": 25}
    return Experiment.model_validate({**plain, "steps": 1000, **changes})


CASES = {
    "plain": ({}, 0.1),
    "shards": ({"output": {"shard_rows": 5000, "dtype": "float64"}}, 0.1),
    "full": ({"policies": ["constant", "safe"], "output": {"latent": "full"}}, 0.2),
    "two": ({"policies": ["constant", "random"], "episodes": 110}, 0.2),  # constant takes half
    "short": ({"setpoints": {"drifting": [10, 50]}, "steps": 7, "episodes": 800, "start": "uniform"}, 0.1),
}


@pytest.mark.parametrize(("changes", "share"), CASES.values(), ids=CASES)
def test_the_bytes_are_close_to_those_made(changes, share):
    """And the counts are exact."""
    experiment = described(**changes)
    guessed = estimate(experiment, Path("made"), workers=1)
    made = ibdata.generate(experiment, "made", workers=1)
    size = sum(path.stat().st_size for path in (made.path / "data").iterdir())
    assert guessed["bytes"] == pytest.approx(size, rel=share)
    for name in ("rows", "episodes", "shards"):
        assert guessed[name] == made.info["counts"][name]


def test_an_estimate_has_place_and_counts():
    guessed = estimate(described(output={"shard_rows": 20_000}), Path("data/guessed"), workers=2)
    counts = ["episodes", "rows", "shards", "bytes", "seconds", "workers"]
    assert list(guessed) == ["name", "out", *counts, "folder"]
    assert (guessed["out"], guessed["workers"], guessed["shards"]) == ("data/guessed", 2, 3)
    assert 0.0 < guessed["seconds"] < 60.0
    assert estimate(described(), Path("data/guessed"), workers=2)["workers"] == 1
    at_url = estimate(described(episodes=1, steps=2), "s3://nowhere/x", workers=1)
    assert (at_url["out"], at_url["folder"]) == ("s3://nowhere/x", None)


def test_a_huge_run_is_estimated_at_once():
    """Of a sample: to make it would take a year."""
    guessed = estimate(described(episodes=10**9, output={"shard_rows": 10**8}), Path("x"), workers=1)
    assert guessed["rows"] == 2 * 10**12
    assert guessed["bytes"] > 10**13


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"workers": 0}, "workers: found 0, expected"),
        ({"out": "file"}, "file: is a file, not a folder"),
        ({"out": "s3://u:KEY@x/y", "overwrite": True}, "s3://…@x/y: --overwrite is for folders"),
        ({"resume": True, "overwrite": True}, "--resume and --overwrite exclude each other"),
    ],
)
def test_what_generate_refuses_is_refused(options, line):
    """What it finds at its place is in test_outcomes.py."""
    Path("file").write_text("mine")
    with pytest.raises(UsageError) as error:
        estimate(described(episodes=1, steps=2), **{"out": "new", "workers": 1, **options})
    assert str(error.value).startswith(line)
