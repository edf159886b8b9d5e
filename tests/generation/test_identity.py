"""Two experiments are one if they say the same: options that an older ibdata did not have do not count."""

import json
from pathlib import Path

import pytest
from helpers import networks
from helpers.datasets import FOUR_SHARDS as TINY
from helpers.folders import receipts, run_of, seal

import ibdata
from ibdata._system.files import read_sealed, sealed, write
from ibdata.errors import UsageError
from ibdata.experiment.dataset_spec import DatasetSpec
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
    assert rich.means(json.loads(recorded))
    found = list(options(rich, json.loads(recorded)))
    assert len(found) > 40
    assert {is_default for _, is_default in found} == {True, False}
    for path, is_default in found:
        data = json.loads(recorded)
        was = at(data, path[:-1]).pop(path[-1])
        assert rich.means(data) == is_default, path
        at(data, path[:-1])[path[-1]] = [was, "other"]
        assert not rich.means(data), path
    for path in ((), ("output",), ("policies", 0), ("splits",)):
        data = json.loads(recorded)
        at(data, path)["unknown"] = None
        assert not rich.means(data), path


def test_a_finished_dataset_of_an_older_ibdata_is_already_there(capsys):
    made = ibdata.generate(TINY, "out", workers=1)
    seal(made.path, lambda listed: [e.pop("licence") for e in listed["experiments"]])
    ibdata.generate(TINY, "out", workers=1)
    assert "already there" in capsys.readouterr().err
    seal(made.path, lambda listed: [e.update(licence="MIT") for e in listed["experiments"]])
    with pytest.raises(UsageError, match=r"^out: holds the dataset of another experiment"):
        ibdata.generate(TINY, "out", workers=1)


def test_an_unfinished_run_of_an_older_ibdata_goes_on(files, tiny):
    ibdata.generate(TINY, "out", workers=1, shards="1/2")
    note = json.loads(read_sealed(run_of("out") / "run.json"))
    for experiment in note["spec"]["experiments"]:
        del experiment["licence"]
        del experiment["output"]["latent"]
    write(run_of("out"), "run.json", sealed(as_json_of(note)))
    kept = {path.name for path in Path(".out.part/run/dataset/data").iterdir()}
    assert len(receipts("out")) == 2
    ibdata.generate(TINY, "out", workers=1)
    assert kept <= {path.name for path in Path("out/data").iterdir()}
    assert files("out") == files(tiny[0].path)


def as_json_of(data):
    return json.dumps(data, indent=2).encode()


def test_objects_are_compared_by_name():
    class Mine:
        def predict(self, observations):
            return observations[:, 1:4] * 0.0

    made = ibdata.load({"name": "x", "setpoints": 70, "policies": [Mine()]})
    recorded = json.loads(json.dumps(made.plain()))
    assert made.means(recorded)
    recorded["policies"][0]["target"] = "Other"
    assert not made.means(recorded)
    assert DatasetSpec.of(made).means(DatasetSpec.of(made).plain())
