"""Parameters of custom policies are data of JSON and YAML, and are the same in every process."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ibdata as library
from ibdata.errors import ConfigError
from ibdata.experiment import Experiment, as_yaml, validated
from ibdata.experiment.yaml import Document

endless: list = []
endless.append(endless)


def plain(params):
    policy = {"kind": "custom", "target": "typed:Actor", "params": params}
    return {"name": "own", "setpoints": 50.0, "policies": [policy], "steps": 4, "output": {"shard_rows": 4}}


@pytest.mark.parametrize(
    ("params", "problem"),
    [
        ({"limit": float("inf")}, "Out of range float"),
        ({"a": {"b": [1, (2, np.float64("nan"))]}}, "Out of range float"),
        ({"limit": 1j}, "Object of type complex"),
        ({"x": np.ones(2)}, "Object of type ndarray"),
        ({"x": {1, 2}}, "Object of type set"),
        ({"x": endless}, "Circular reference"),
    ],
)
def test_what_would_not_come_back_as_it_was_is_refused(params, problem):
    line = rf"^policies\.0\.params: found what JSON cannot hold \({problem}.*\), expected finite numbers"
    with pytest.raises(ConfigError, match=line):
        validated(plain(params))


def test_it_is_said_with_its_line_before_anything_runs(ibdata, tmp_path):
    lines = [
        "name: own", "setpoints: 50", "policies:", "  - kind: custom", "    target: typed:Actor",
        "    params: {limit: 1e400, fine: 1e300}",
    ]  # fmt: skip
    (tmp_path / "own.yaml").write_text("\n".join(lines))
    done = ibdata("generate", "--config", "own.yaml", "--out", "out", "--allow-code")
    assert done.returncode == 2
    assert done.stderr.startswith("own.yaml:6:13: policies.0.params: found what JSON cannot hold")
    assert not (tmp_path / "out").exists()


TEXTS = st.text(st.characters(codec="utf-8", exclude_characters="\x85"), max_size=8)
NUMBERS = st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False)
LEAVES = st.none() | st.booleans() | st.integers() | NUMBERS | TEXTS
PARAMS = st.dictionaries(
    TEXTS,
    st.recursive(LEAVES, lambda inner: st.lists(inner) | st.dictionaries(TEXTS, inner), max_leaves=8),
    max_size=3,
)


@given(PARAMS)
@settings(derandomize=True, deadline=None)
def test_all_others_come_back_from_the_manifest_and_from_yaml(params):
    made = Experiment.model_validate(plain(params))
    assert made.policies[0].params == params
    for again in (json.loads(json.dumps(made.plain())), Document(as_yaml(made)).data):
        other = Experiment.model_validate(again)
        assert other == made
        assert repr(other.policies[0].params) == repr(made.policies[0].params)
        assert [cell.digest for cell in other.cells] == [cell.digest for cell in made.cells]


class Half(float):
    """A number of one's own type, as numpy has them."""


def test_what_json_would_turn_into_something_else_is_that_from_the_start():
    params = {"pair": (1, 2), "half": Half(0.5), "numpy": np.float64(0.25)}
    made = Experiment.model_validate(plain(params)).policies[0].params
    assert made == {"pair": [1, 2], "half": 0.5, "numpy": 0.25}
    assert [type(value) for value in made.values()] == [list, float, float]


def test_parameters_that_are_changed_afterwards_leave_the_experiment():
    layers = [1, 2]
    made = Experiment.model_validate(plain({"layers": layers}))
    layers.append(3)
    assert made.policies[0].params == {"layers": [1, 2]}


CODE = """
import numpy as np

class Actor:
    def __init__(self, value):
        self.value = 0.25 if isinstance(value, list) else 0.5

    def act(self, history, u):
        return np.full((len(history), 3), self.value)
"""


@pytest.mark.slow
def test_a_policy_sees_the_same_with_one_worker_and_with_two(tmp_path, monkeypatch):
    (tmp_path / "typed.py").write_text(CODE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    experiment = Experiment.model_validate({**plain({"value": (1, 2)}), "setpoints": [20.0, 70.0]})
    try:
        made = [library.generate(experiment, f"out-{n}", workers=n, allow_code=True) for n in (1, 2)]
        assert made[0].content_root == made[1].content_root
        assert library.reproduce("out-2", allow_code=True) == (2, [])
    finally:
        sys.modules.pop("typed", None)
