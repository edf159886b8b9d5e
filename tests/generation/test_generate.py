"""What `generate` takes, what it refuses before it begins, and what it says."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from helpers.folders import contents
from helpers.tiny import FOUR_SHARDS as TINY

import ibdata
from ibdata.errors import ConfigError, IbdataError, UsageError
from ibdata.generation.engine import ENGINES, select_engine


def test_an_experiment_has_several_forms():
    """An experiment, its mapping and its file, by a relative or an absolute path, make one dataset."""
    Path("tiny.yaml").write_text(json.dumps(TINY.plain()))
    forms = [TINY, TINY.plain(), "tiny.yaml", Path("tiny.yaml").resolve()]
    assert (
        len({ibdata.generate(form, f"out/{i}", workers=1).content_root for i, form in enumerate(forms)}) == 1
    )


@pytest.mark.parametrize("name", ["random", "random.yaml"])
def test_a_shipped_name_is_enough(name):
    """A shipped experiment is made in data/<name> of the current folder."""
    made = ibdata.generate(name, overrides=["steps=2", "policies.0.name=mine"], workers=1)
    assert (made.path, len(made)) == (Path("data/random"), 20)
    assert made.episodes["policy"].unique().tolist() == ["mine"]


def test_a_seed_replaces_that_of_the_experiment():
    """`seed` makes the dataset of the experiment with that seed, which its YAML holds."""
    other = TINY.model_copy(update={"seed": 9})
    made = [ibdata.generate(TINY, "a", seed=9, workers=1), ibdata.generate(other, "b", workers=1)]
    assert made[0].content_root == made[1].content_root
    assert made[0].content_root != ibdata.generate(TINY, "c", workers=1).content_root
    assert ibdata.load("a/meta/experiment.yaml") == other


def test_what_is_made_is_what_the_yaml_gives():
    """A changed experiment is checked and planned again."""
    changed = TINY.model_copy(deep=True)
    assert len(changed.cells) == 2
    changed.setpoints.append(30.0)
    made = ibdata.generate(changed, "changed", workers=1)
    assert made.episodes["setpoint"].unique().tolist() == [20.0, 70.0, 30.0]
    assert ibdata.validate("changed") == []
    changed.setpoints.append(300.0)
    with pytest.raises(ConfigError, match=r"^setpoints\.3: found 300\.0, expected"):
        ibdata.generate(changed, "out", workers=1)
    assert not Path("out").exists()


@pytest.mark.parametrize(
    ("config", "options", "line"),
    [
        ("no-such.yaml", {}, "config: found 'no-such.yaml', expected a file or one of"),
        (TINY, {"overrides": ["steps"]}, "override: found 'steps', expected key=value"),
        (TINY, {"overrides": {"steps": 0}}, "override steps: found 0, expected"),
        (TINY, {"workers": 0}, "workers: found 0, expected a whole number in [1, 1024]"),
        (TINY, {"workers": "2"}, "workers: found '2', expected a whole number in [1, 1024]"),
        (TINY, {"workers": 10**6}, "workers: found 1000000, expected a whole number in [1, 1024]"),
        (TINY, {"engine": "ray", "workers": 0}, "workers: found 0, expected a whole number in [1, 1024]"),
        (TINY, {"engine": "dask"}, "engine: found 'dask', expected one of local, ray"),
        (TINY, {"address": "auto"}, "address: found 'auto', which is only for the engine ray"),
        (TINY, {"seed": -1}, "seed: found -1"),
        ("random", {"seed": -1}, "seed: found -1"),
    ],
)
@pytest.mark.parametrize("shards", [None, "1/2"])
def test_bad_arguments_are_refused(config, options, line, shards):
    """Arguments that are invalid, or that exclude each other, are refused before anything is made."""
    with pytest.raises(UsageError) as error:
        ibdata.generate(config, shards=shards, **options)
    assert str(error.value).startswith(line)
    assert contents() == {}


def test_without_ray_its_extra_is_named(monkeypatch):
    """The engine ray needs its library, and the error says how to get it."""
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(IbdataError, match=r"^the engine ray needs .* ray: pip install ray, or 'ibdata\[ray"):
        select_engine("ray", None, None)


def test_the_command_offers_all_engines():
    """The choices of --engine are the engines that there are."""
    from ibdata.cli.generate import command

    (option,) = (parameter for parameter in command.params if parameter.name == "engine")
    assert list(option.type.choices) == list(ENGINES)
