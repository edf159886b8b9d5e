"""The search for an experiment by path or name, and folders of experiments."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from helpers import ROOT

import ibdata
from ibdata.errors import ConfigError, UsageError
from ibdata.experiment import find, load, load_all, shipped, suites
from ibdata.experiment.shipped import catalogue, description
from ibdata.policies.weights_file import SHIPPED

TEXT = "name: {name}\nsetpoints: 70\npolicies: [{{kind: random}}]\n"


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def folder():
    """A folder with two experiments and other files."""
    made = Path("two")
    made.mkdir()
    for file, name in (("b", "first"), ("a", "second")):
        (made / f"{file}.yaml").write_text(TEXT.format(name=name))
    (made / "notes.txt").write_text("no experiment")
    return made


def test_find_takes_a_path_and_else_a_shipped_name():
    assert find("random") == find("random.yaml") == shipped()["random"]
    Path("random.yaml").write_text(TEXT.format(name="x"))
    assert find("random.yaml") == Path("random.yaml")
    assert load("random.yaml").setpoints == 70.0


def test_a_suite_and_its_files_are_shipped_by_name():
    assert find("siemens-offline") == find("siemens-offline/") == suites()["siemens-offline"]
    assert find("siemens-offline/bad-20.yaml") == shipped()["siemens-offline/bad-20"]
    assert load("siemens-offline/bad-20").name == "siemens-offline-bad-20"
    assert len(load_all("siemens-offline")[1]) == 16


def test_the_name_of_a_folder_without_experiments_is_free():
    Path("random").mkdir()
    assert find("random") == shipped()["random"]
    (Path("random") / "x.yaml").write_text(TEXT.format(name="x"))
    assert find("random") == Path("random")


def test_a_folder_is_loaded_in_the_order_of_its_files(folder):
    path, made = load_all(folder)
    assert (path, [experiment.name for experiment in made]) == (folder, ["second", "first"])
    assert load_all(folder / "a.yaml") == (folder / "a.yaml", [load(folder / "a.yaml")])
    _, made = load_all(folder, ["steps=3"], seed=4)
    assert [(experiment.steps, experiment.seed) for experiment in made] == [(3, 4)] * 2


def problems(*args):
    with pytest.raises(ConfigError) as caught:
        load_all(*args)
    return list(caught.value.problems)


def test_the_problems_of_all_files_are_told_at_once(folder):
    (folder / "a.yaml").write_text(TEXT.format(name="A"))
    (folder / "b.yaml").write_text(TEXT.format(name="b").replace("70", "101"))
    first, second = problems(folder)
    assert first.startswith("two/a.yaml:1:7: name: found 'A'")
    assert second == "two/b.yaml:2:12: setpoints: found 101, expected a number of at most 100"


def test_a_problem_of_an_override_is_told_once(folder):
    assert problems(folder, ["policies.1.kind=safe"]) == ["override policies.1.kind: there is no item 1"]


def test_a_folder_where_one_file_is_meant_is_refused(folder):
    with pytest.raises(UsageError) as caught:
        load(folder)
    assert str(caught.value) == (
        "two: found a folder of experiments, expected a file such as two/a.yaml; generate takes a folder"
    )


@pytest.mark.parametrize("config", [None, 42, ["random"]])
def test_what_is_no_experiment_is_refused(config):
    with pytest.raises(
        UsageError, match=f"^config: found {re.escape(repr(config))}, expected a file, the name"
    ):
        load(config)


@pytest.mark.parametrize(("config", "near"), [("randm.yaml", "random"), ("zzzzzz", None)])
def test_a_config_that_is_nowhere_is_refused_with_names(config, near):
    with pytest.raises(UsageError) as caught:
        load(config)
    names = ", ".join([*(name for name in shipped() if "/" not in name), *suites()])
    expected = f"; did you mean {near!r}?" if near else f", expected a file or one of {names}"
    assert str(caught.value) == f"config: found {config!r}{expected}"


@pytest.mark.parametrize("config", ["x" * 300, "a\0b", ".", ""], ids=["long", "NUL", "folder", "empty"])
def test_a_path_that_cannot_be_read_is_a_usage_error(config):
    with pytest.raises(UsageError) as caught:
        load(config)
    assert not isinstance(caught.value, ConfigError)


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
    sets = {each.name.removeprefix("siemens-offline-"): each for each in load_all("siemens-offline")[1]}
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
    points = {name: split.setpoint for name, split in transfer.splits.items()}
    assert points == {"source": 50, "target": 75, "test": 75}
    for experiment, few in ((transfer, 2), (load("transfer", ["episodes=7"]), 1)):
        n = experiment.episodes
        assert episodes_of(experiment) == {"source": range(n), "target": range(few), "test": range(few, n)}


@pytest.mark.parametrize(
    ("suite", "sizes"),
    [
        ("neorl-like", {99_000: 3}),
        ("setpoints", {262_500: 2}),
        ("d4rl-like", {1_000_000: 4, 2_000_000: 1}),
        ("d4rl-like-all", {1_000_000: 4, 2_000_000: 1}),
    ],
)
def test_every_set_of_a_suite_has_its_size(suite, sizes):
    rows = [each.rows for each in load_all(suite)[1]]
    assert {size: rows.count(size) for size in rows} == sizes
    assert not suite.startswith("d4rl") or load(f"{suite}/medium-expert").rows == 2_000_000


def test_setpoints_apart_are_those_of_the_protocol():
    _, sets = load_all("setpoints")
    assert [made.labels for made in sets] == [("expert",), ("random",)]
    for made in sets:
        assert [cell.setpoint for cell in made.cells] == [5.0 * i for i in range(21)]
        points = {name: split.setpoint for name, split in made.splits.items()}
        assert points == {"train": list(range(0, 80, 5)), "test": list(range(80, 101, 5))}
        assert (made.dynamics, made.start, made.steps, made.episodes) == ("siemens", "default", 250, 50)


@pytest.mark.parametrize("name", NEORL)
def test_returns_like_neorls_are_within_three_percent(name):
    """Over 50 episodes, the standard error is below 0.7 %."""
    [policy] = load(f"neorl-like/{name}").policies
    [found] = ibdata.evaluate(policy, 70, steps=1000, discount=1.0, episodes=50).results
    assert found.standard_error < 0.007 * abs(found.mean_return)
    assert found.mean_return == pytest.approx(NEORL[name], rel=0.03)


@pytest.mark.parametrize("suite", ["d4rl-like", pytest.param("d4rl-like-all", marks=pytest.mark.slow)])
def test_half_trained_networks_are_between_random_and_expert(suite):
    policies = {name: load(f"{suite}/{name}").policies[0] for name in ("random", "medium", "expert")}
    points = [cell.setpoint for cell in load(f"{suite}/random").cells]
    found = ibdata.evaluate(policies, points, steps=1000, discount=1.0, episodes=4)
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
