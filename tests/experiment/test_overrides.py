"""Overrides `key.sub=value` and the seed: read and checked as in YAML, with errors that name their keys."""

from __future__ import annotations

import pytest
from helpers.refusals import refused

import ibdata
from ibdata.experiment import Experiment
from ibdata.experiment.yaml import Document

KEYS = ", ".join(Experiment.model_fields)
STICKY = "policies.0={kind: sticky, kappa: 1, base: bad}"
REFUSED = {
    "steps": ": found 'steps', expected key=value",
    "=5": ": found the key '', expected names joined by dots",
    "policies[0].name=x": ": found the key 'policies[0].name'; did you mean 'policies.0.name'?",
    "output['dtype']=float64": ": found the key \"output['dtype']\"; did you mean 'output.dtype'?",
    "a..b=1": ": found the key 'a..b', expected names joined by dots",
    "policies.1.kind=safe": " policies.1.kind: there is no item 1",
    "steps=&a 1": " steps: found an anchor or alias, expected plain data",
    "steps=[1": " steps: not valid YAML: expected ',' or ']', but got '<stream end>'",
    "steps=0": " steps: found 0, expected a whole number of at least 1",
    "steps=": " steps: found null, expected a whole number",
    "stpes=3": " stpes: no such option; did you mean 'steps'?",
    "output.laten=full": " output.laten: no such option; did you mean 'latent'?",
    "0=1": f" 0: no such option; expected one of {KEYS}",
    "²=1": f" ²: no such option; expected one of {KEYS}",
    "a\0=1": f" a\\x00: no such option; expected one of {KEYS}",
    "name.foo=1": ' name: found {"foo": 1}, expected text',
}


@pytest.mark.parametrize(
    ("overrides", "attribute", "value"),
    [
        ([" steps = 5 # five"], "steps", 5),
        (["steps=5", "steps=1e3"], "steps", 1000),
        (["name=on"], "name", "on"),
        (["output={dtype: float64}", "output.latent=full"], "output.dtype", "float64"),
        (["setpoints=[10, 20]", "setpoints.1=30"], "setpoints", [10.0, 30.0]),
        (["policies.0.kind=safe"], "labels", ("safe",)),
        ([STICKY, "policies.0.base=safe"], "policies.0.base.kind", "safe"),
        (["policies.0={kind: constant, action: [0, 0, 1]}"], "policies.0.action", (0.0, 0.0, 1.0)),
        (["dynamics={base: paper, eta_mean: 1}"], "scenario.variant.eta_mean", 1.0),
        (["splits.1.episodes=1"], "splits.keys", {"1"}),
    ],
)
def test_overrides_replace_what_the_file_says(loaded, with_lines, overrides, attribute, value):
    """Those of a mapping are the same."""
    found = loaded(with_lines(), overrides)
    pairs = (override.split("=", 1) for override in overrides)
    assert loaded(with_lines(), {key.strip(): Document(text).data for key, text in pairs}) == found
    for part in attribute.split("."):
        found = found[int(part)] if part.isdigit() else getattr(found, part)
    assert (found() if callable(found) else found) == value


@pytest.mark.parametrize(("override", "problem"), REFUSED.items(), ids=REFUSED)
def test_an_override_that_does_not_fit_names_its_key(loaded, with_lines, override, problem):
    assert refused("^override", loaded, with_lines(), [override]) == f"override{problem}"


def test_problems_of_file_overrides_and_seed_are_told_at_once(problems, with_lines):
    """Of several overrides with one key, the last one counts; what one leaves out names it too."""
    overrides = ["steps=0", "steps=-1", "setpoints.start=3", "output.dtype=float64"]
    assert problems(with_lines("episodes: 0"), overrides, seed=-1) == [
        "override setpoints.stop: missing, expected a value",
        "override setpoints.step: missing, expected a value",
        "x.yaml:1:11: episodes: found 0, expected a whole number of at least 1",
        "override steps: found -1, expected a whole number of at least 1",
        "seed: found -1, expected a whole number of at least 0",
    ]


def test_the_code_of_a_file_is_found_by_a_copy_of_an_experiment_with_its_policies(tmp_path, monkeypatch):
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub/mine.py").write_text("def still(observations):\n    return 0 * observations[:, :3]\n")
    (tmp_path / "sub/mine.yaml").write_text(
        "{name: a, setpoints: 20, policies: [{kind: custom, target: 'mine.py:still'}]}"
    )
    policies = ibdata.load(tmp_path / "sub/mine.yaml").policies
    copied = ibdata.load(
        ibdata.Experiment(name="b", setpoints=70, policies=policies), {"policies.0.name": "c"}
    )
    monkeypatch.chdir(tmp_path)
    found = ibdata.evaluate(copied.policies, steps=3, episodes=2, allow_code=True)
    assert found.results[0].policy == "c"


def test_the_default_of_an_option_may_be_written():
    plain = {"name": "a", "setpoints": 20, "policies": ["safe"]}
    assert ibdata.load(plain) == ibdata.load(plain, {"output.expert_action": False})
