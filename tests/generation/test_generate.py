"""What `generate` and `estimate` take, one experiment or a folder of them, and what they refuse."""

import json
import re
import sys
from pathlib import Path

import pytest
from helpers.datasets import FOUR_SHARDS as TINY
from helpers.folders import contents
from helpers.refusals import refused

import ibdata
from ibdata import Experiment
from ibdata.cli.make import generate_command as command
from ibdata.errors import ConfigError, IbdataError, UsageError
from ibdata.generation.estimate import estimate
from ibdata.generation.workers import ENGINES, select_engine


def test_a_shipped_name_is_enough():
    made = ibdata.generate("random", overrides=["steps=2", "policies.0.name=mine"], workers=1)
    assert (made.place, len(made)) == ("data/random", 20)
    assert made.episodes["policy"].unique().tolist() == ["mine"]


def test_a_seed_replaces_that_of_the_experiment(tiny):
    other = TINY.model_copy(update={"seed": 9})
    made = ibdata.generate(TINY, "a", seed=9, workers=1)
    assert made.content_root == ibdata.generate(other, "b", workers=1).content_root
    assert made.content_root != tiny[0].content_root
    assert ibdata.load("a/meta/experiment.yaml") == other


WORKERS = "workers: found {}, expected a whole number in [1, 1024]"
REFUSED = [
    ("no-such.yaml", {}, "config: found 'no-such.yaml', expected a file or one of"),
    (TINY, {"overrides": {"steps": 0}}, "override steps: found 0, expected"),
    (TINY, {"workers": "2"}, "workers: found '2', expected a whole number or None"),
    (TINY, {"workers": 10**6}, WORKERS.format(10**6)),
    (TINY, {"engine": "ray", "workers": 0}, WORKERS.format(0)),
    (TINY, {"engine": "dask"}, "engine: found 'dask', expected one of local, ray"),
    (TINY, {"address": "auto"}, "address: found 'auto', which is only for the engine ray"),
    (TINY, {"seed": -1}, "seed: found -1"),
    ("random", {"seed": -1}, "seed: found -1"),
]


def test_bad_arguments_are_refused():
    for config, options, line in REFUSED:
        for shards in (None, "1/2"):
            refused(f"^{re.escape(line)}", ibdata.generate, config, shards=shards, **options)
    assert contents() == {}


def test_the_engines_are_offered_and_ray_names_its_extra(monkeypatch):
    (option,) = (parameter for parameter in command.params if parameter.name == "engine")
    assert list(option.type.choices) == list(ENGINES)
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(IbdataError, match=r"^the engine ray needs .* ray: pip install ray, or 'ibdata\[ray"):
        select_engine("ray", None, None)


PLAIN = {"setpoints": 70, "policies": [{"kind": "random"}], "steps": 5}


@pytest.fixture
def two():
    folder = Path("two")
    folder.mkdir()
    for name in ("a", "b"):
        (folder / f"{name}.yaml").write_text(json.dumps({**PLAIN, "name": f"set-{name}"}))
    return folder


def test_each_experiment_is_made_as_alone(two):
    """One that is there already is not made again."""
    alone = ibdata.generate(two / "b.yaml", "alone", workers=1, seed=3)
    done = ibdata.generate(two / "a.yaml", "out/a", workers=1, seed=3)
    made = ibdata.generate(two, "out", workers=1, seed=3)
    assert list(made) == ["a", "b"]
    assert made["a"].manifest == done.manifest
    assert (made["b"].place, made["b"].content_root) == ("out/b", alone.content_root)
    assert ibdata.generate(two / "a.yaml", workers=1).place == "data/set-a"


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


@pytest.mark.parametrize(
    "changes",
    [
        {"output": {"shard_rows": 5000, "dtype": "float64"}},
        {"setpoints": {"drifting": [10, 50]}, "steps": 7, "episodes": 800, "start": "uniform"},
    ],
    ids=["shards", "short"],
)
def test_the_bytes_are_close_to_those_made(changes):
    """And the counts are exact."""
    plain = {"name": "guessed", "setpoints": [20.0, 70.0], "policies": ["random"], "episodes": 25}
    experiment = Experiment.model_validate({**plain, "steps": 1000, **changes})
    guessed = estimate(experiment, Path("made"))
    made = ibdata.generate(experiment, "made", workers=1)
    size = sum(path.stat().st_size for path in (made.path / "data").iterdir())
    assert guessed["bytes"] == pytest.approx(size, rel=0.1)
    for name in ("rows", "episodes", "shards"):
        assert guessed[name] == made.info["counts"][name]
