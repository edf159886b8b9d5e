"""The experiments that come with ibdata: their list, their sizes, and the policies of the suites."""

from __future__ import annotations

import json

import pytest
from helpers import ROOT

import ibdata
from ibdata.experiment import load, load_all, shipped, suites
from ibdata.experiment.catalogue import catalogue, description
from ibdata.policies.weights_file import SHIPPED

NEORL = {"low": -344_311, "medium": -283_121, "high": -220_156}  # Qin et al. 2022


def test_every_shipped_experiment_is_listed():
    found = {each.name: each for each in catalogue()}
    assert set(found) == {*shipped(), *(f"{suite}/" for suite in suites())}
    assert found["random"].rows == 10_000
    assert found["siemens-offline/"].rows == 16 * load("siemens-offline/bad-0").rows
    assert found["siemens-offline/"].description == "A folder of 16 experiments."


@pytest.mark.parametrize("name", shipped())
def test_the_first_line_of_the_comment_is_a_sentence(name):
    said = description(shipped()[name])
    assert said[0].isupper()
    assert said.endswith(".")
    assert len(said) <= 120


def episodes_of(made):
    return {name: split.indices(made.episodes) for name, split in made.splits.items()}


def test_the_siemens_sets_are_the_baselines_at_five_levels():
    sets = {each.name.removeprefix("siemens-offline-"): each for each in load_all("siemens-offline")}
    baselines = ("bad", "mediocre", "optimized")
    assert list(sets) == sorted([*(f"{b}-{e}" for b in baselines for e in (0, 20, 40, 60, 80)), "global-100"])
    for name, made in sets.items():
        kind, level = name.split("-")
        greedy = {"kind": "epsilon_greedy", "base": {"kind": kind}, "epsilon": int(level) / 100}
        [cell] = made.cells
        expected = {"0": {"kind": kind}, "100": {"kind": "random"}}.get(level, greedy)
        assert (cell.policy.form(), cell.label) == (expected, name)
        assert (made.dynamics, made.setpoints, made.start) == ("siemens", 70.0, "default")
        assert (made.episodes, made.steps) == (100, 1000)
        assert episodes_of(made) == {"train": range(90), "validation": range(90, 100)}


def test_the_experiments_of_papers_have_their_sizes():
    depeweg, transfer = load("depeweg"), load("transfer")
    assert [cell.setpoint for cell in depeweg.cells] == [10.0 * i for i in range(1, 11)]
    assert (depeweg.episodes, depeweg.steps, depeweg.labels) == (10, 1000, ("random",))
    assert episodes_of(depeweg) == {"train": range(7), "test": range(7, 10)}
    assert {name: split.setpoint for name, split in transfer.splits.items()} == {"source": 50, "target": 75}
    episodes = episodes_of(transfer)
    assert len(episodes["target"]) < len(episodes["source"]) == transfer.episodes


@pytest.mark.parametrize(
    ("suite", "sizes"),
    [
        ("neorl-like", {99_000: 3}),
        ("d4rl-like", {1_000_000: 4, 2_000_000: 1}),
        ("d4rl-like-all", {1_000_000: 4, 2_000_000: 1}),
    ],
)
def test_every_set_of_a_suite_has_its_size(suite, sizes):
    rows = [each.rows for each in load_all(suite)]
    assert {size: rows.count(size) for size in rows} == sizes
    assert suite == "neorl-like" or load(f"{suite}/medium-expert").rows == 2_000_000


@pytest.mark.parametrize("name", NEORL)
def test_returns_like_neorls_are_within_three_percent(name):
    """Over 100 episodes, the standard error is below 0.5 %."""
    [policy] = load(f"neorl-like/{name}").policies
    [found] = ibdata.evaluate(policy, 70, steps=1000, discount=1.0, episodes=100).results
    assert found.standard_error < 0.005 * abs(found.mean_return)
    assert found.mean_return == pytest.approx(NEORL[name], rel=0.03)


@pytest.mark.parametrize("suite", ["d4rl-like", "d4rl-like-all"])
def test_half_trained_networks_are_between_random_and_expert(suite):
    policies = {name: load(f"{suite}/{name}").policies[0] for name in ("random", "medium", "expert")}
    points = [cell.setpoint for cell in load(f"{suite}/random").cells]
    found = ibdata.evaluate(policies, points, steps=1000, discount=1.0, episodes=10)
    random, medium, expert = found.returns.mean(axis=(1, 2))
    assert 0.2 < (medium - random) / (expert - random) < 0.5


def test_the_shipped_networks_are_recorded_and_small():
    made = json.loads((ROOT / "docs/figures/learned-policies.json").read_text(encoding="utf-8"))
    files = sorted(SHIPPED.glob("*.safetensors"))
    assert {path.stem for path in files} == {each["file"] for each in made["shipped"].values()}
    assert sum(path.stat().st_size for path in files) < 1_500_000


def test_a_learned_set_is_made_and_is_valid(tmp_path):
    changes = {"episodes": 1, "steps": 50}
    made = ibdata.generate("neorl-like/low", tmp_path / "low", overrides=changes, workers=1)
    assert ibdata.validate(made.path) == []
    assert len(list((made.path / "meta").glob("policy-*.safetensors"))) == 1
