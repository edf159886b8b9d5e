"""The shipped suites of learned behaviours, and the networks that they play."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import ibdata
from ibdata.experiment import load, load_all
from ibdata.policies.weights_file import SHIPPED

NEORL = {"low": -344_311, "medium": -283_121, "high": -220_156}  # Qin et al. 2022
SUITES = {"neorl-like": 3, "d4rl-like": 5, "d4rl-like-all": 5}
MADE = Path(__file__).resolve().parents[2] / "docs/figures/learned-policies.json"


@pytest.mark.parametrize("name", NEORL)
def test_returns_like_neorls_are_within_three_percent(name):
    """Over 100 episodes, the standard error is below 0.5 %."""
    [policy] = load(f"neorl-like/{name}").policies
    [found] = ibdata.evaluate(policy, 70, steps=1000, discount=1.0, episodes=100).results
    assert found.standard_error < 0.005 * abs(found.mean_return)
    assert found.mean_return == pytest.approx(NEORL[name], rel=0.03)


@pytest.mark.parametrize("suite", SUITES)
def test_every_set_of_a_suite_has_its_size(suite):
    made = load_all(suite)
    assert len(made) == SUITES[suite]
    rows = {each.name.removeprefix(f"{suite}-"): each.rows for each in made}
    if suite == "neorl-like":
        assert set(rows.values()) == {99_000}
    else:
        assert rows.pop("medium-expert") == 2_000_000
        assert set(rows.values()) == {1_000_000}


def test_half_trained_networks_are_between_random_and_expert():
    for suite in ("d4rl-like", "d4rl-like-all"):
        policies = {name: load(f"{suite}/{name}").policies[0] for name in ("random", "medium", "expert")}
        points = [cell.setpoint for cell in load(f"{suite}/random").cells]
        found = ibdata.evaluate(policies, points, steps=1000, discount=1.0, episodes=10)
        random, medium, expert = found.returns.mean(axis=(1, 2))
        assert 0.2 < (medium - random) / (expert - random) < 0.5


def test_the_shipped_networks_are_recorded_and_small():
    shipped = json.loads(MADE.read_text())["shipped"]
    files = sorted(SHIPPED.glob("*.safetensors"))
    assert {path.stem for path in files} == {each["file"] for each in shipped.values()}
    assert sum(path.stat().st_size for path in files) < 1_500_000


def test_a_learned_set_is_made_and_is_valid(tmp_path):
    made = ibdata.generate(
        "neorl-like/low", tmp_path / "low", overrides={"episodes": 1, "steps": 50}, workers=1
    )
    assert ibdata.validate(made.path) == []
    assert len(list((made.path / "meta").glob("policy-*.safetensors"))) == 1
