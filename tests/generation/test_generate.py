"""What `generate` takes, what it refuses before it begins, and what it says."""

import sys
from pathlib import Path

import pytest
from helpers.folders import contents
from helpers.tiny import FOUR_SHARDS as TINY

import ibdata
from ibdata.cli.generate import command
from ibdata.errors import ConfigError, IbdataError, UsageError
from ibdata.generation.engine import ENGINES, select_engine


@pytest.mark.parametrize("name", ["random", "random.yaml"])
def test_a_shipped_name_is_enough(name):
    made = ibdata.generate(name, overrides=["steps=2", "policies.0.name=mine"], workers=1)
    assert (made.path, len(made)) == (Path("data/random"), 20)
    assert made.episodes["policy"].unique().tolist() == ["mine"]


def test_a_seed_replaces_that_of_the_experiment(tiny):
    other = TINY.model_copy(update={"seed": 9})
    made = ibdata.generate(TINY, "a", seed=9, workers=1)
    assert made.content_root == ibdata.generate(other, "b", workers=1).content_root
    assert made.content_root != tiny[0].content_root
    assert ibdata.load("a/meta/experiment.yaml") == other


def test_a_changed_experiment_is_checked_and_planned_again():
    changed = TINY.model_copy(deep=True)
    assert len(changed.cells) == 2
    changed.setpoints.append(30.0)
    made = ibdata.generate(changed, "changed", workers=1)
    assert made.episodes["setpoint"].unique().tolist() == [20.0, 70.0, 30.0]
    changed.setpoints.append(300.0)
    with pytest.raises(ConfigError, match=r"^setpoints\.3: found 300\.0, expected"):
        ibdata.generate(changed, "out", workers=1)
    assert not Path("out").exists()


WORKERS = "workers: found {}, expected a whole number in [1, 1024]"


@pytest.mark.parametrize(
    ("config", "options", "line"),
    [
        ("no-such.yaml", {}, "config: found 'no-such.yaml', expected a file or one of"),
        (TINY, {"overrides": {"steps": 0}}, "override steps: found 0, expected"),
        (TINY, {"workers": "2"}, WORKERS.format("'2'")),
        (TINY, {"workers": 10**6}, WORKERS.format(10**6)),
        (TINY, {"engine": "ray", "workers": 0}, WORKERS.format(0)),
        (TINY, {"engine": "dask"}, "engine: found 'dask', expected one of local, ray"),
        (TINY, {"address": "auto"}, "address: found 'auto', which is only for the engine ray"),
        (TINY, {"seed": -1}, "seed: found -1"),
        ("random", {"seed": -1}, "seed: found -1"),
        (TINY, {"resume": True, "overwrite": True}, "--resume and --overwrite exclude each other"),
    ],
)
@pytest.mark.parametrize("shards", [None, "1/2"])
def test_bad_arguments_are_refused(config, options, line, shards):
    with pytest.raises(UsageError) as error:
        ibdata.generate(config, shards=shards, **options)
    assert str(error.value).startswith(line)
    assert contents() == {}


def test_the_engines_are_offered_and_ray_names_its_extra(monkeypatch):
    (option,) = (parameter for parameter in command.params if parameter.name == "engine")
    assert list(option.type.choices) == list(ENGINES)
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(IbdataError, match=r"^the engine ray needs .* ray: pip install ray, or 'ibdata\[ray"):
        select_engine("ray", None, None)
