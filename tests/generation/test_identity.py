"""Two experiments are one if they say the same: options that an older ibdata did not have do not count."""

import json
from pathlib import Path

import pytest
from helpers import networks
from helpers.datasets import FOUR_SHARDS as TINY
from helpers.objects import Mine
from helpers.refusals import refused
from pydantic.fields import FieldInfo

import ibdata
from ibdata.dataset import manifest
from ibdata.experiment import Experiment
from ibdata.plan.dataset_spec import DatasetSpec
from ibdata.policies import base

NETWORK = {"kind": "network", "file": "actor.safetensors"}
PLAIN = {
    "name": "rich",
    "setpoints": {"drifting": [20, 70]},
    "dynamics": {"base": "siemens", "eta_mean": 0.2},
    "policies": [
        {"kind": "random", "name": "own"},
        NETWORK,
        {"kind": "gaussian", "base": NETWORK, "scale": 0.2},
        {"kind": "mixture", "bases": ["safe", "optimized"], "weights": [0.5, 0.5]},
        {"kind": "sticky", "base": {"kind": "epsilon_greedy", "base": "safe", "epsilon": 0.25}, "kappa": 0.5},
    ],
    "start": {"burn_in": [1, 9]},
    "steps": 4,
    "episodes": 4,
    "output": {"shard_rows": 32, "dtype": "float64"},
    "splits": {"train": {"episodes": "first 50%"}, "both": {"episodes": {"stop": 3}, "overlap": True}},
}


@pytest.fixture
def rich(tmp_path):
    (tmp_path / "actor.safetensors").write_bytes(networks.weights())
    (tmp_path / "rich.yaml").write_text(json.dumps(PLAIN))
    return ibdata.load(tmp_path / "rich.yaml")


def options(value, recorded, path=()):
    """Every option in recorded data: its path, and whether it equals its default."""
    if isinstance(value, base.FrozenModel):
        for name, field in type(value).model_fields.items():
            if name in recorded:
                option = getattr(value, name)
                yield (*path, name), option == field.get_default(call_default_factory=True)
                yield from options(option, recorded[name], (*path, name))
    elif isinstance(recorded, list):
        for i, item in enumerate(recorded):
            yield from options(value[i], item, (*path, i))
    elif isinstance(recorded, dict) and not isinstance(value, str):
        for key, item in recorded.items():
            yield from options(value[key], item, (*path, key))


def at(data, path):
    for key in path:
        data = data[key]
    return data


def test_what_is_not_recorded_counts_as_the_default(rich):
    """And what is recorded counts, so that a changed default makes another experiment."""
    recorded = json.dumps(rich.plain())
    assert rich.difference(json.loads(recorded)) is None
    found = list(options(rich, json.loads(recorded)))
    assert len(found) > 40
    assert {is_default for _, is_default in found} == {True, False}
    for path, is_default in found:
        data = json.loads(recorded)
        at(data, path[:-1]).pop(path[-1])
        assert (rich.difference(data) is None) == is_default, path
        at(data, path[:-1])[path[-1]] = "other data"
        assert rich.difference(data).startswith(f"{'.'.join(map(str, path))}: found 'other data', expected ")
    for path in ((), ("output",), ("policies", 0), ("splits",)):
        data = json.loads(recorded)
        at(data, path)["unknown"] = 1
        assert rich.difference(data) == f"{'.'.join(map(str, (*path, 'unknown')))}: found 1, expected nothing"


@pytest.fixture
def with_option():
    """A function that gives experiments a further option, or another default of it."""
    fields = Experiment.__pydantic_fields__

    def add(name, kind, default):
        before.setdefault(name, fields.get(name))
        fields[name] = FieldInfo(annotation=kind, default=default)
        Experiment.model_rebuild(force=True)

    before = {}
    yield add
    for name, field in before.items():
        if field is None:
            del fields[name]
        else:
            fields[name] = field
    Experiment.model_rebuild(force=True)


def made_again():
    """What a careful user asks for again, by a call each: a dataset and a run, in a folder and in a store."""
    plain = {key: value for key, value in TINY.plain().items() if key != "licence"}
    url = f"file://{Path('there').absolute()}"
    return {
        "finished": lambda **more: ibdata.generate(plain | more, "finished", workers=1),
        "begun": lambda shards=None, **more: ibdata.generate(plain | more, "begun", workers=1, shards=shards),
        "there": lambda **more: ibdata.generate(plain | more, url, workers=1),
        "begun there": lambda shards=None, **more: ibdata.generate(
            plain | more, url.replace("there", "begun-there"), workers=1, shards=shards
        ),
    }


@pytest.fixture
def four_places():
    """A finished dataset and an unfinished run, in folders and at URLs."""
    calls = made_again()
    calls["finished"]()
    calls["there"]()
    calls["begun"](shards="1/2")
    calls["begun there"](shards="1/2")
    return calls


def test_a_new_option_with_a_default_changes_nothing_that_is_there(four_places, with_option, capsys):
    """As CONTRIBUTING.md says that an option is added."""
    runs = [Path(".begun.part/run"), *Path(".begun-there.part").iterdir()]
    made = {path: path.stat().st_mtime_ns for run in runs for path in run.glob("dataset/data/*")}
    with_option("purpose", str, "research")
    root = four_places["finished"]().content_root
    assert capsys.readouterr().err == "ibdata: finished: already there; nothing was written\n"
    assert ibdata.validate("finished") == []
    assert ibdata.reproduce("finished")[1] == []
    Path("finished/meta/dataset.json").unlink()
    ibdata.repair("finished")
    assert ibdata.validate("finished") == []
    for name in ("begun", "begun there"):  # it goes on with the shards that are there
        four_places[name](shards="1/2")
    assert {path: path.stat().st_mtime_ns for run in runs for path in run.glob("dataset/data/*")} == made
    for call in four_places.values():
        assert call().content_root == root
        refused(r"of another experiment .purpose: found .*, expected 'fun'", call, purpose="fun")


def test_another_default_makes_another_experiment(four_places, with_option):
    """What older data say is what their default was. None was not recorded: then the data version says it."""
    with_option("licence", str, "MIT")
    for name in ("finished", "begun"):
        refused(r"another experiment .licence: found 'CC-BY-4.0', expected 'MIT'", four_places[name])


def test_a_default_that_was_none_needs_a_data_version(four_places, with_option, monkeypatch):
    with_option("purpose", str, "research")  # instead of None, which an older ibdata did not record
    monkeypatch.setattr(manifest, "DATA_VERSION", 4)
    refused(r"^finished: not a dataset .*found data version 3, expected 4", four_places["finished"])
    for name in ("begun", "begun there"):
        refused(r"begun.*: .*another experiment .data version: found 3, expecte", four_places[name])


def test_objects_are_compared_by_name():
    made = ibdata.load({"name": "x", "setpoints": 70, "policies": [Mine()]})
    recorded = json.loads(json.dumps(made.plain()))
    assert made.difference(recorded) is None
    recorded["policies"][0]["target"] = "Other"
    assert made.difference(recorded).startswith("policies.0.target: found 'Other', expected ")
    made_of = DatasetSpec.of(made)
    assert made_of.difference("y", [made.plain()]) == "name: found 'y', expected 'x'"
    assert made_of.difference("x", [made.plain()] * 2) == "experiments: found 2, expected 1"
