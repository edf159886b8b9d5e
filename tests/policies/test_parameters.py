"""Parameters of custom policies are data of JSON and YAML, and are the same in every process."""

from __future__ import annotations

import json

import numpy as np
import pytest
from helpers.refusals import refused

from ibdata.errors import ConfigError
from ibdata.evaluation.policies import as_policy
from ibdata.experiment import Experiment, as_yaml
from ibdata.experiment.yaml import Document

endless: list = []
endless.append(endless)


def plain(params):
    return {
        "name": "own",
        "setpoints": 50.0,
        "policies": [{"kind": "custom", "target": "a:b", "params": params}],
    }


@pytest.mark.parametrize(
    ("params", "problem"),
    [
        ({"limit": float("inf")}, "Out of range float"),
        ({"a": {"b": [1, (2, np.float64("nan"))]}}, "Out of range float"),
        ({"limit": 1j}, "Object of type complex"),
    ],
)
def test_what_would_not_come_back_as_it_was_is_refused(params, problem):
    line = rf"^policy: params: found what JSON cannot hold \({problem}.*\), expected finite numbers"
    refused(line, as_policy, {"kind": "custom", "target": "a:b", "params": params}, error=ConfigError)


@pytest.mark.parametrize(
    ("value", "error"), [(endless, "list .*: RecursionError"), ({1, "a"}, "set .*: TypeError")]
)
def test_what_cannot_be_a_list_is_refused(value, error):
    refused(f"^found a {error}", as_policy, {"kind": "custom", "target": "a:b", "params": {"x": value}})


def test_arrays_tuples_and_sets_are_lists():
    params = {"x": np.ones(2), "y": (np.int64(1),), "z": {2, 1}}
    made = as_policy({"kind": "custom", "target": "a:b", "params": params})
    assert made.params == {"x": [1.0, 1.0], "y": [1], "z": [1, 2]}


def test_all_others_come_back_from_the_manifest_and_from_yaml():
    texts = ["", "null", "1e3", "on", "é\u2028\U0001f600", " a: b #", "'\"\\\n\t", "- x", "\x7f\0"]
    numbers = [0, -0.0, 1.0, 0.1, 1e-300, -1.7976931348623157e308, 2**70, -1, True, None]
    params = {"": [texts, [numbers], [], {}], "a": {text: {"a": text} for text in texts}}
    made = Experiment.model_validate(plain(params))
    assert made.policies[0].params == params
    for again in (json.loads(json.dumps(made.plain())), Document(as_yaml(made)).data):
        other = Experiment.model_validate(again)
        assert other == made
        assert repr(other.policies[0].params) == repr(made.policies[0].params)


def test_they_are_from_the_start_what_json_makes_of_them():
    params = {"pair": [1, 2], "numpy": np.float64(0.25), "tuple": (1, 2)}
    made = Experiment.model_validate(plain(params)).policies[0].params
    params["pair"].append(3)
    assert repr(made) == repr({"pair": [1, 2], "numpy": 0.25, "tuple": [1, 2]})


@pytest.mark.parametrize("target", [3, None, int, ["x"]])
def test_an_object_that_cannot_act_is_refused(target):
    with pytest.raises(ConfigError, match=r"^policies.0.target: found .*, expected an object with "):
        Experiment(name="x", setpoints=70, policies=[{"kind": "live", "target": target}])
