"""The estimate of a run is close to the run, and leaves no files."""

from __future__ import annotations

from pathlib import Path

import pytest

import ibdata
from ibdata import Experiment
from ibdata.errors import UsageError
from ibdata.generation.estimate import estimate


def described(**changes):
    plain = {
        "name": "guessed",
        "setpoints": [20.0, 70.0],
        "policies": [{"kind": "random"}],
        "episodes": 25,
        "steps": 1000,
    }
    return Experiment.model_validate({**plain, **changes})


def parquet_bytes(dataset):
    return sum(path.stat().st_size for path in (dataset.path / "data").iterdir())


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"output": {"shard_rows": 5000, "dtype": "float64"}},
        {"policies": [{"kind": "constant"}, {"kind": "safe"}], "output": {"latent": "full"}},
        {"policies": [{"kind": "constant"}, {"kind": "random"}], "episodes": 110},  # constant takes half
        {"setpoints": {"drifting": [10, 50, 90]}, "steps": 7, "episodes": 800, "start": "uniform"},
    ],
    ids=["plain", "shards", "full", "two", "short"],
)
def test_the_bytes_are_within_a_tenth_of_those_made(changes):
    """The estimated bytes are within a tenth of those made, and the counts are exact."""
    experiment = described(**changes)
    guessed = estimate(experiment, Path("made"), workers=1)
    made = ibdata.generate(experiment, "made", workers=1)
    assert guessed["bytes"] == pytest.approx(
        parquet_bytes(made), rel=0.2 if len(experiment.cells) > 3 else 0.1
    )
    counts = made.info["counts"]
    assert {name: guessed[name] for name in ("rows", "episodes", "shards")} == {
        name: counts[name] for name in ("rows", "episodes", "shards")
    }


def test_an_estimate_has_place_and_counts():
    """An estimate has the place, the counts and the number of worker processes."""
    guessed = estimate(described(output={"shard_rows": 20_000}), Path("data/guessed"), workers=2)
    assert list(guessed) == [
        "name",
        "out",
        "episodes",
        "rows",
        "shards",
        "bytes",
        "seconds",
        "workers",
        "folder",
    ]
    assert (guessed["out"], guessed["workers"], guessed["shards"]) == ("data/guessed", 2, 3)
    assert estimate(described(), Path("data/guessed"), workers=2)["workers"] == 1
    assert 0.0 < guessed["seconds"] < 60.0


def test_a_huge_run_is_estimated_at_once():
    """An estimate of a run that would take a year returns, so it makes a sample only."""
    guessed = estimate(described(episodes=10**9, output={"shard_rows": 10**8}), Path("x"), workers=1)
    assert guessed["rows"] == 2 * 10**12
    assert guessed["bytes"] > 10**13


def test_a_url_is_named_as_it_was_given():
    guessed = estimate(described(episodes=1, steps=2), "s3://nowhere/x", workers=1)
    assert (guessed["out"], guessed["folder"]) == ("s3://nowhere/x", None)


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"workers": 0}, "workers: found 0, expected"),
        ({"out": "file"}, "file: is a file, not a folder"),
        ({"out": "foreign"}, "foreign: not a dataset of ibdata"),
        ({"out": "s3://u:KEY@x/y", "overwrite": True}, "s3://…@x/y: --overwrite is for folders"),
        ({"out": "foreign", "overwrite": True}, "foreign: not a dataset of ibdata"),
    ],
)
def test_what_generate_refuses_is_refused(options, line):
    """An estimate of a run that `generate` would refuse is the same error."""
    Path("file").write_text("mine")
    Path("foreign").mkdir()
    Path("foreign/mine").write_text("mine")
    ibdata.generate(described(episodes=1, steps=3), "made", workers=1)
    with pytest.raises(UsageError) as error:
        estimate(described(episodes=1, steps=2), **{"out": "new", "workers": 1, **options})
    assert str(error.value).startswith(line)
