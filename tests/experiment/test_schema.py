"""A resolved experiment is read back unchanged, and the JSON Schema agrees with the loader."""

from __future__ import annotations

import jsonschema
import pytest

from ibdata.errors import ConfigError
from ibdata.experiment import Experiment, as_yaml, load, load_all, shipped
from ibdata.experiment.yaml import Document

SPECIAL = {
    "least": ["version: 1"],
    "names that look like something else": [
        "name: '1e3'",
        "policies: [{kind: constant, action: [0.1, -1, 1e-7], name: 'null'}, {kind: safe, name: '0'}]",
        "splits: {'1': {policy: 'null'}, 'true': {policy: '0'}, on: {overlap: true}}",
    ],
    "policies around others": [
        "policies: [{kind: epsilon_greedy, base: {kind: constant, action: [0, 1, -0.1]}, epsilon: 0.2},"
        " {kind: epsilon_greedy, base: {kind: bad}, epsilon: 1, name: a},"
        " {kind: gaussian, base: {kind: optimized}, scale: 1e-3}]",
    ],
    "bare names of policies": ["policies: [random, safe, {kind: gaussian, base: optimized, scale: 1}]"],
    "drifting": ["name: 'on'", "setpoints: drifting", "start: uniform"],
    "drifting from several": ["setpoints: {drifting: [10, 0.1]}", "start: {burn_in: [0, 64]}"],
    "numbers at their ends": [
        "setpoints: [1.1754943508222875e-38, 100, 0.30000000000000004, 0]",
        "seed: 18446744073709551615",
        "steps: 2147483647",
        "output: {latent: next, dtype: float64, shard_rows: 100000000}",
    ],
    "a licence": ["licence: (MIT OR Apache-2.0) AND LicenseRef-mine+"],
    "a range": ["setpoints: {start: 0, stop: 1, step: 0.1}", "output: {latent: false}"],
    "dynamics of one's own": [
        "dynamics: {base: paper, convolution_weights: [0, 0, 1, 0, 0], drift_length: 7, eta_mean: 1}",
        "episodes: 5",
        "splits: {a: {episodes: {start: 1, stop: 2}}, b: {episodes: 1, setpoint: 70}}",
    ],
}
BAD = [
    "steps: 0", "steps: 1.5", "steps: true", "seed: 18446744073709551616", "epsiodes: 3", "dynamics: simens",
    "dynamics: {base: paper, eta_man: 1}", "start: {burn_in: [3]}", "output: {latent: yes}", "version: 2",
    "splits: {A: {}}", "splits: {a: {overlap: 1}}", "setpoints: 101", "setpoints: '70'",
    "setpoints: {start: 1}", "policies: [{kind: rndom}]", "policies: [rndom]", "policies: [gaussian]",
    "policies: [{kind: gaussian, base: safe, scale: 1}]", "policies: []", "name: A",
    "licence: ''", "licence: 'MIT '", 'licence: "MIT\\nBSD"', "licence: 'a|b'", "licence: 0.1", "licence: é1",
    "policies: [{kind: gaussian, base: {kind: safe}, scale: 1}]",
    "policies: [{kind: epsilon_greedy, base: {kind: epsilon_greedy}, epsilon: 1}]",
    "policies: [{kind: epsilon_greedy, base: {kind: bad}, epsilon: 2}]",
]  # fmt: skip
special = pytest.mark.parametrize("lines", SPECIAL.values(), ids=SPECIAL)


@pytest.fixture(scope="module")
def schema():
    schema = Experiment.model_json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def is_read_back(experiment, loaded):
    again = loaded(as_yaml(experiment))
    assert again == experiment
    assert again.plain() == experiment.plain()
    assert [cell.digest for cell in again.cells] == [cell.digest for cell in experiment.cells]
    assert again.labels == experiment.labels
    assert as_yaml(again) == as_yaml(experiment)
    assert Experiment.model_validate(experiment.plain()) == experiment


@special
def test_a_resolved_experiment_is_read_back_as_it_was(loaded, with_lines, lines):
    is_read_back(loaded(with_lines(*lines)), loaded)


@pytest.mark.parametrize("name", shipped())
def test_a_shipped_experiment_is_read_back_as_it_was(loaded, name):
    is_read_back(load(name), loaded)


def test_the_resolved_experiment_holds_every_default(loaded, with_lines):
    plain = loaded(with_lines()).plain()
    assert set(plain) == set(Experiment.model_fields)
    assert plain["output"] == {"dtype": "float32", "latent": True, "shard_rows": 1_000_000}
    assert plain["licence"] == "CC-BY-4.0"


@pytest.mark.parametrize("name", shipped())
def test_a_shipped_config_has_its_files_name_and_is_valid(schema, name):
    text = shipped()[name].read_bytes()
    assert text.startswith(b"# yaml-language-server: $schema=")
    assert load(name).name == name.replace("/", "-")
    schema.validate(Document(text).data)
    schema.validate(load(name).plain())


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


def episodes_of(made):
    return {name: split.indices(made.episodes) for name, split in made.splits.items()}


def test_the_experiments_of_papers_have_their_sizes():
    depeweg, transfer = load("depeweg"), load("transfer")
    assert [cell.setpoint for cell in depeweg.cells] == [10.0 * i for i in range(1, 11)]
    assert (depeweg.episodes, depeweg.steps, depeweg.labels) == (10, 1000, ("random",))
    assert episodes_of(depeweg) == {"train": range(7), "test": range(7, 10)}
    assert {name: split.setpoint for name, split in transfer.splits.items()} == {"source": 50, "target": 75}
    episodes = episodes_of(transfer)
    assert len(episodes["target"]) < len(episodes["source"]) == transfer.episodes


@special
def test_what_loads_fits_the_schema(schema, with_lines, lines):
    schema.validate(Document(with_lines(*lines)).data)


@pytest.mark.parametrize("line", BAD)
def test_neither_the_schema_nor_the_loader_takes_what_is_bad(schema, loaded, with_lines, line):
    with pytest.raises(ConfigError):
        loaded(with_lines(line))
    assert not schema.is_valid(Document(with_lines(line)).data)


def test_every_key_is_described_or_says_it_all_by_its_name(schema):
    """What an editor shows beside a key."""
    bare = {key for key, value in schema.schema["properties"].items() if "description" not in value}
    assert bare <= {"name", "policies", "seed", "output"}
