"""A resolved experiment is read back unchanged and fits the JSON Schema; see also test_load.py."""

from __future__ import annotations

import copy
import re
from functools import reduce
from operator import getitem

import pytest

from ibdata.errors import ConfigError
from ibdata.experiment import Experiment, as_yaml, load, shipped
from ibdata.experiment.yaml import Document
from ibdata.plan.dataset_spec import DatasetSpec

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


def is_read_back(experiment, loaded, folder):
    for name, data in DatasetSpec.of(experiment).weights.items():
        (folder / name).write_bytes(data)  # beside the YAML file, as in a dataset
    again = loaded(as_yaml(experiment))
    assert again == experiment
    assert again.plain() == experiment.plain()
    assert [cell.digest for cell in again.cells] == [cell.digest for cell in experiment.cells]
    assert again.labels == experiment.labels
    assert as_yaml(again) == as_yaml(experiment)
    assert load(experiment) == experiment


@pytest.mark.parametrize("lines", SPECIAL.values(), ids=SPECIAL)
def test_what_loads_is_read_back_and_fits_the_schema(schema, loaded, with_lines, tmp_path, lines):
    is_read_back(loaded(with_lines(*lines)), loaded, tmp_path)
    schema.validate(Document(with_lines(*lines)).data)


@pytest.mark.parametrize("name", shipped())
def test_a_shipped_config_is_read_back_and_fits_the_schema(schema, loaded, tmp_path, name):
    text, made = shipped()[name].read_bytes(), load(name)
    assert text.startswith(b"# yaml-language-server: $schema=")
    assert made.name == name.replace("/", "-")
    is_read_back(made, loaded, tmp_path)
    schema.validate(Document(text).data)
    schema.validate(made.plain())


def test_the_resolved_experiment_holds_every_default(loaded, with_lines):
    plain = loaded(with_lines()).plain()
    assert set(plain) == set(Experiment.model_fields)
    assert plain["output"] == {
        "dtype": "float32",
        "latent": True,
        "expert_action": False,
        "shard_rows": 1_000_000,
    }
    assert plain["licence"] == "CC-BY-4.0"


BLOCKS = [
    "version: 1",
    "episodes: 1000",
    "steps: 5",
    "seed: 5",
    "setpoints: {start: 10, stop: 90, step: 10}",
    "setpoints: {drifting: [10, 90]}",
    "start: {burn_in: [0, 100000]}",
    "output: {shard_rows: 100000, expert_action: true, latent: false}",
    "dynamics: {base: paper, eta_mean: 1, bernoulli_bounds: [0, 1], alpha_threshold: 1, drift_length: 7}",
    "dynamics: {base: paper, drift_rate: [-100, 100], consumption_offset: 0, consumption_noise: 0}",
    "splits: {a: {setpoint: 70, episodes: 1, overlap: true}, b: {setpoint: [70], overlap: false}}",
    "policies: [{kind: constant, action: [0, 0, 1]}]",
    "policies: [{kind: custom, target: a:b, history: 3, draws: 3}]",
    "policies: [{kind: custom, target: a:b, deterministic: false}]",
    "policies: [{kind: epsilon_greedy, base: safe, epsilon: 0.5}]",
    "policies: [{kind: gaussian, base: bad, scale: 0.5}]",
    "policies: [{kind: ornstein_uhlenbeck, base: bad, theta: 0.5, sigma: 0.5}]",
    "policies: [{kind: sticky, base: safe, kappa: 0.5}]",
    "policies: [{kind: multisine, sines: 1, period: 9000, amplitude: 0.5}]",
    "policies: [{kind: prbs, order: 5, hold: 7, amplitude: 0.5}]",
    "policies: [{kind: mixture, bases: [safe, bad], weights: [2, 3]}]",
    "policies: [{kind: schedule, stages: [{base: safe, steps: 5, epsilon: [0.5, 0.25]}, {base: bad}]}]",
]
CANDIDATES = [True, "1", None, 0, 1, 1.0, 0.5, 1e3, -1, 1e-6, 1.5, 1e6 + 1, 2.0**31, 2**48, 2**64]
ACROSS = re.compile(
    "files, expected|expected some of|one of the setpoints|below start|in this order|to be|found none|as 6|"
    "setpoints, expected"
)


def leaves(data, path=()):
    """The paths of all numbers."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        yield from leaves(value, (*path, key))
    if isinstance(data, int | float):
        yield path


@pytest.mark.parametrize("line", BLOCKS)
def test_schema_and_models_take_the_same_numbers(schema, with_lines, line):
    """One rule for all: 1.0 is a whole number, true is none. Only models have rules across options."""
    data, wrong = Document(with_lines(line)).data, []
    for path in leaves({key: data[key] for key in [line.partition(":")[0]]}):
        for candidate in CANDIDATES:
            changed = copy.deepcopy(data)
            *parents, last = path
            reduce(getitem, parents, changed)[last] = candidate
            try:
                load(changed)
                is_taken = True
            except ConfigError as error:
                is_taken = all(ACROSS.search(problem) for problem in error.problems)
            if is_taken != schema.is_valid(changed):
                wrong.append((path, candidate, is_taken))
    assert wrong == []
