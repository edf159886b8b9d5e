"""The scale of a score is that of the dynamics in which it is evaluated."""

from __future__ import annotations

import pytest
from helpers.variants import FIELDS

import ibdata
from ibdata.dataset.reference_returns import scale
from ibdata.experiment.scenario import other_dynamics, scenario_of
from ibdata.policies import POLICIES

FEW = {"setpoint": 70, "steps": 60, "episodes": 20}
PAPER = POLICIES["expert"](dynamics="paper")


def test_an_expert_score_is_100_for_the_expert_of_the_same_dynamics():
    found = ibdata.evaluate({"own": PAPER, "other": "expert"}, dynamics="paper", **FEW)
    own, other = found.results
    assert own.expert_score == pytest.approx(100.0)
    assert other.expert_score < 60.0  # it is made for siemens
    line = "other: this expert is made for siemens; for paper, write {kind: expert, dynamics: paper}"
    assert found.notes == [line]
    changed = {"base": "paper", "consumption_offset": 0.5}
    found = ibdata.evaluate(PAPER, dynamics=changed, **FEW)
    assert found.results[0].expert_score == pytest.approx(100.0)
    line = "this expert is made for paper as published, but here consumption_offset = 0.5"
    assert found.notes == [f"expert: {line}", f"expert_score: {line}"]
    found = ibdata.evaluate("expert", **FEW)
    assert (found.results[0].expert_score, found.notes) == (pytest.approx(100.0), [])


def test_a_run_says_that_an_expert_is_made_for_other_dynamics(tmp_path, capsys):
    plain = {"name": "x", "setpoints": 70, "steps": 5, "dynamics": "paper"}
    ibdata.generate(
        {**plain, "policies": [{"kind": "sticky", "base": "expert", "kappa": 0.5}]}, tmp_path / "a"
    )
    assert "ibdata: sticky: this expert is made for siemens; for paper, write" in capsys.readouterr().err
    ibdata.generate({**plain, "policies": [{"kind": "expert", "dynamics": "paper"}]}, tmp_path / "b")
    assert capsys.readouterr().err == ""
    asked = {**plain, "policies": ["random"], "output": {"expert_action": True}}
    ibdata.generate({**asked, "dynamics": {"base": "siemens", "drift_length": 3}}, tmp_path / "c")
    line = "output.expert_action: this expert is made for siemens as published, but here drift_length = 3"
    assert f"ibdata: {line}\n" in capsys.readouterr().err


@pytest.mark.parametrize("field", FIELDS)
@pytest.mark.parametrize("base", ["siemens", "paper"])
def test_what_is_measured_in_published_dynamics_says_or_refuses_where_any_field_is_another(base, field):
    published = getattr(FIELDS[field], base)
    for value in (published, *FIELDS[field].moved):
        scenario = scenario_of(dynamics={"base": base, field: value})
        lines = [*other_dynamics(scenario.expert, scenario)]
        of_scale = scale(scenario.cells([("expert", scenario.expert)])[0].dynamics, "default", 1000, 1.0)
        if value == published:
            assert (lines, of_scale.dynamics) == ([], base)
        else:
            [line] = lines
            assert line.startswith(f"this expert is made for {base} as published, but here {field} = ")
            assert of_scale is None
