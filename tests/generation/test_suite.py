"""Generating a folder of experiments: all are checked first, and each gets its own folder."""

import json
from pathlib import Path

import pytest

import ibdata
from ibdata.errors import ConfigError, UsageError
from ibdata.experiment import suites

PLAIN = {"setpoints": 70, "policies": [{"kind": "random"}], "steps": 5}


@pytest.fixture
def two():
    folder = Path("two")
    folder.mkdir()
    for name in ("a", "b"):
        (folder / f"{name}.yaml").write_text(json.dumps({**PLAIN, "name": f"set-{name}"}))
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("suite", suites())
def test_a_shipped_suite_makes_valid_datasets(suite):
    made = ibdata.generate(suite, workers=1, overrides=["episodes=1", "steps=20"])
    assert list(made) == [path.stem for path in sorted(suites()[suite].glob("*.yaml"))]
    for name, dataset in made.items():
        experiment = ibdata.load(f"{suite}/{name}")
        assert dataset.path == Path("data") / suite / name
        assert ibdata.validate(dataset.path) == []
        assert len(dataset) == 20 * len(experiment.cells)
        assert set(dataset.to_pandas(["policy"])["policy"]) == set(experiment.labels)


@pytest.mark.parametrize(
    ("name", "episodes"),
    [("depeweg", {"train": 70, "test": 30}), ("siemens-offline/bad-20", {"train": 90, "validation": 10})],
)
def test_a_shipped_set_is_split_by_episode(name, episodes):
    """The rows are those of a set without splits."""
    made = ibdata.generate(name, workers=1, overrides={"steps": 5})
    assert {name: split["episodes"] for name, split in made.splits.items()} == episodes
    assert ibdata.validate(made.path) == []
    plain = ibdata.generate(name, "plain", workers=1, overrides={"steps": 5, "splits": {}})
    assert (plain.splits, plain.content_root) == ({}, made.content_root)


@pytest.mark.parametrize("resume", [False, True])
def test_each_experiment_is_made_as_alone(two, resume):
    """One that is there already is not made again."""
    alone = ibdata.generate(two / "b.yaml", "alone", workers=1, seed=3)
    done = ibdata.generate(two / "a.yaml", "out/a", workers=1, seed=3)
    made = ibdata.generate(two, "out", workers=1, seed=3, resume=resume)
    assert list(made) == ["a", "b"]
    assert made["a"].manifest == done.manifest
    assert (made["b"].path, made["b"].content_root) == (Path("out/b"), alone.content_root)
    assert ibdata.generate(two / "a.yaml", workers=1).path == Path("data/set-a")


def test_all_are_checked_before_the_first_is_made(two):
    ibdata.generate(two / "b.yaml", "data/two/b", workers=1, seed=1)
    Path("file").touch()
    for options, line in (
        ({"overrides": ["steps=0"]}, "steps: found 0"),
        ({}, "data/two/b: holds the dataset of another experiment"),
        ({"out": "out", "workers": 0}, "workers: found 0"),
        ({"out": "file"}, "file: is a file, not a folder"),
        ({"out": "s3://bucket/x"}, "found a URL for a folder of experiments"),
    ):
        with pytest.raises((ConfigError, UsageError), match=line):
            ibdata.generate(two, **{"workers": 1, **options})
    assert [path.name for path in Path("data/two").iterdir()] == ["b"]
    assert not Path("out").exists()


def test_the_estimates_are_those_of_the_single_runs(two):
    guessed = ibdata.estimate(two, workers=1)
    assert [(g["name"], g["out"], g["rows"]) for g in guessed["experiments"]] == [
        ("set-a", "data/two/a", 5),
        ("set-b", "data/two/b", 5),
    ]
    assert (guessed["out"], guessed["rows"]) == ("data/two", 10)
    assert len(guessed.to_pandas()) == 2
    assert not Path("data").exists()
