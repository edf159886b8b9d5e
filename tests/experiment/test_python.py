"""Experiments from Python: mappings, bare names of policies, overrides as mappings, and their errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ibdata.experiment import Experiment, load, load_all
from ibdata.generation.estimate import estimate
from ibdata.policies import POLICIES

PLAIN = {"name": "x", "setpoints": [20, 70], "policies": [{"kind": "random"}, {"kind": "safe"}], "steps": 3}
TEXT = "name: x\nsetpoints: [20, 70]\npolicies: [random, {kind: safe}]\nsteps: 3\n"


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("x.yaml").write_text(TEXT)


FORMS = {
    "a file": lambda: "x.yaml",
    "a path": lambda: Path("x.yaml"),
    "a mapping": lambda: PLAIN,
    "an experiment": lambda: Experiment(**PLAIN),
}


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_every_form_is_the_same_experiment(form):
    expected = Experiment(**{**PLAIN, "steps": 2, "seed": 5})
    for overrides in (["steps=2"], {"steps": 2}):
        assert load(form(), overrides, seed=5) == expected
        assert load_all(form(), overrides, seed=5).experiments == [expected]
        assert estimate(form(), overrides=overrides, seed=5)["rows"] == expected.rows
    given = form()
    assert load(given) == Experiment(**PLAIN)
    assert load(given, {"output.dtype": "float64", "policies.0.name": "a"}) is not given
    assert load(given) == Experiment(**PLAIN)  # what is given does not change


def test_the_types_of_python_and_numpy_are_those_of_yaml():
    made = Experiment(
        name="x",
        setpoints=np.arange(20, 71, 50),
        policies=("random", {"kind": "constant", "action": np.zeros(3)}),
        episodes=np.int64(2),
        start={"burn_in": (1, 2)},
        splits={"a": {"setpoint": np.float64(20)}, "b": {"setpoint": (70,)}},
    )
    assert made == load(made.plain())
    assert made.setpoints == [20.0, 70.0]
    for points in (range(10, 31, 10), np.array([10, 20, 30])):
        assert load(PLAIN, {"setpoints": points}).setpoints == [10.0, 20.0, 30.0]
    assert load(PLAIN, {"splits.b": {"setpoint": np.float64(20)}}) == load(PLAIN, ["splits.b={setpoint: 20}"])


def test_an_object_of_an_unknown_class_is_live():
    class Mine(POLICIES["safe"]):
        """A policy that ibdata does not know."""

    for call in (lambda: load({**PLAIN, "policies": [Mine()]}), lambda: load(PLAIN, {"policies": [Mine()]})):
        assert call().plain()["policies"][0]["target"] == "Mine"
    assert load({**PLAIN, "policies": [POLICIES["safe"]()]}).labels == ("safe",)
