"""The scale of a score is that of the dynamics in which it is evaluated."""

from __future__ import annotations

import pytest

import ibdata
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
    assert ibdata.evaluate(PAPER, dynamics=changed, **FEW).results[0].expert_score == pytest.approx(100.0)
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
