"""The estimate of a run is close to the run, and leaves no files."""

from pathlib import Path

import pytest

import ibdata
from ibdata import Experiment
from ibdata.generation.estimate import estimate


def described(**changes):
    plain = {"name": "guessed", "setpoints": [20.0, 70.0], "policies": ["random"], "episodes": 25}
    return Experiment.model_validate({**plain, "steps": 1000, **changes})


CASES = {
    "plain": ({}, 0.1),
    "shards": ({"output": {"shard_rows": 5000, "dtype": "float64"}}, 0.1),
    "two": ({"policies": ["constant", "random"], "episodes": 50}, 0.2),  # constant takes half
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


def test_a_huge_run_is_estimated_at_once():
    """Of a sample: to make it would take a year."""
    guessed = estimate(described(episodes=10**9, output={"shard_rows": 10**8}), "s3://nowhere/x", workers=1)
    assert (guessed["rows"], guessed["out"], guessed["folder"]) == (2 * 10**12, "s3://nowhere/x", None)
    assert guessed["bytes"] > 10**13
    assert guessed["seconds"] > 10**5
