"""Every rule finds the row that breaks it, in a file whose hash is correct; tests/corpus has more."""

import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from helpers.datasets import AS_WRITTEN
from helpers.folders import seal

import ibdata
from ibdata._system.storage import Storage
from ibdata.errors import BusyError
from ibdata.plan.dataset_spec import spec_in
from ibdata.tools.checks import check_shard
from ibdata.tools.rules import RULES
from ibdata.tools.validate import validate


@pytest.fixture
def shard(copied, shard_file):
    """The path of the shard that is damaged."""
    return shard_file(copied, 1)


def put(path, name, row, value):
    """Put values into a column of a Parquet file."""
    table = pq.read_table(path)
    values = table[name].to_pylist()
    values[row] = value
    index, field = table.column_names.index(name), table.schema.field(name)
    pq.write_table(table.set_column(index, field, pa.array(values, field.type)), path, **AS_WRITTEN)


def rules(folder):
    return {(p.path, p.row, p.rule) for p in validate(folder)}


def test_a_dataset_that_was_just_made_is_valid(either):
    assert validate(either.path) == []
    assert validate(either.path, quick=True) == []


BROKEN = [
    ("obs_velocity", 3, float("nan"), "finite"),
    ("obs_gain", 5, 100.5, "bounds"),
    ("episode", 7, 99, "indices"),
    ("terminated", 7, True, "flags"),
    ("truncated", 39, False, "flags"),
    ("next_obs_shift", 11, 50.5, "continuity"),
    ("reward", 13, -1.0, "reward"),
    ("obs_setpoint", 0, 21.0, "setpoint"),
    ("policy", 2, "other", "policy"),
    ("next_obs_velocity", 39, 33.25, "steering"),
    ("act_gain", 4, 0.015625, "steering"),
    ("latent_theta_3", 17, 66.5, "shift register"),
    ("action_log_prob", 21, -1.5, "density"),
]


def test_a_broken_row_is_named_with_its_rule(copied, shard):
    spec, whole = spec_in(ibdata.open(copied).stored), (copied / shard).read_bytes()
    for name, row, value, rule in BROKEN:
        put(copied / shard, name, row, value)
        problems = check_shard(spec, spec.shards[1], Storage(copied), shard)[1]
        assert (row, rule) in {(p.row, p.rule) for p in problems}, name
        (copied / shard).write_bytes(whole)


@pytest.mark.parametrize(("name", "rule"), [("reward", "reward"), ("next_obs_velocity", "steering")])
def test_a_value_ten_roundings_off_is_named(copied, shard, name, rule):
    """By definition, a rule allows for what rounding to float32 does: about three, and four, such steps."""
    value = np.float32(pq.read_table(copied / shard)[name][39].as_py())
    put(copied / shard, name, 39, float(value + 10 * np.spacing(value)))
    spec = spec_in(ibdata.open(copied).stored)
    problems = check_shard(spec, spec.shards[1], Storage(copied), shard)[1]
    assert (39, rule) in {(p.row, p.rule) for p in problems}


def test_many_broken_rows_are_one_problem_that_counts_them(copied, shard):
    put(copied / shard, "obs_gain", slice(None), np.full(40, 101.0))
    seal(copied)
    (found,) = (p for p in validate(copied) if p.rule == "bounds" and p.message.startswith("obs_gain"))
    line = f"{shard}: row 0: bounds: obs_gain: found 101.0, expected at most 100 (40 such rows)"
    assert str(found) == line


def test_rows_that_keep_every_rule_but_are_others_are_named(copied, shard):
    """Nothing is said of a hidden value at the first step, but that it is the one that was listed."""
    put(copied / shard, "latent_mu_v", 0, 0.25)
    seal(copied)
    assert rules(copied) >= {(shard, None, "digest"), ("meta/episodes.table", None, "metadata")}


def test_a_file_that_is_changed_or_missing_is_named(copied, shard):
    paths = sorted([shard, "meta/statistics.json", "meta/experiment.yaml"])
    for path in paths:
        data = bytearray((copied / path).read_bytes())
        data[len(data) // 2] ^= 1
        (copied / path).write_bytes(data)
    for quick in (True, False):  # of rows that are read while their file is hashed, nothing else is said
        assert sorted((p.path, p.rule) for p in validate(copied, quick)) == [(path, "hash") for path in paths]
    for path in paths:
        (copied / path).unlink()
    assert sorted((p.path, p.rule) for p in validate(copied)) == [(path, "file") for path in paths]


def test_a_dataset_that_is_replaced_meanwhile_is_busy(copied, monkeypatch):
    def replacing(*arguments):
        seal(copied, lambda listed: listed.update(versions={"ibdata": "another"}))
        return check_shard(*arguments)

    monkeypatch.setattr("ibdata.tools.validate.check_shard", replacing)
    with pytest.raises(BusyError, match="replaced while it was read; open it again") as error:
        validate(copied)
    assert error.value.exit_code == 75


NOISE = {"kind": "ornstein_uhlenbeck", "base": {"kind": "optimized"}}
FADING = [{"base": {"kind": "bad"}, "steps": 7, "epsilon": [1.0, 0.0]}, {"base": NOISE}]
POLICIES = [
    NOISE,
    {"kind": "sticky", "base": {"kind": "random"}, "kappa": 0.5},
    {"kind": "prbs"},
    {"kind": "multisine"},
    {"kind": "gaussian", "base": {"kind": "multisine"}, "scale": 0.1},
    {"kind": "mixture", "bases": [NOISE, {"kind": "safe"}, {"kind": "prbs"}]},
    {"kind": "schedule", "stages": FADING},
]
STEPS = 21


@pytest.fixture(scope="module", params=["default", {"burn_in": [2, 6]}], ids=["default", "burn-in"])
def made(request, tmp_path_factory):
    plain = {"name": "x", "setpoints": [20.0, 70.0], "episodes": 3, "steps": STEPS, "start": request.param}
    plain |= {"policies": POLICIES, "output": {"expert_action": True}}
    return ibdata.generate(plain, tmp_path_factory.mktemp("densities") / "x", workers=1)


def test_the_densities_of_every_policy_are_found_to_be_right(made):
    assert ibdata.validate(made.path) == ibdata.reproduce(made.path)[1] == []


DENSITIES = [(number, "action_log_prob", "density") for number in (0, 1, 2, 5, 6)]


LATE = [*DENSITIES, (4, "expert_act_gain", "expert action")]


def test_every_rule_has_a_case_that_breaks_it():
    assert {rule for *_, rule in (*BROKEN, *LATE)} == set(RULES)


def test_validate_says_which_rules_it_checks():
    said = " ".join(validate.__doc__.split())
    assert f"schema, no nulls, {', '.join(RULES)}." in said


@pytest.mark.parametrize(("number", "name", "rule"), LATE)
def test_a_wrong_answer_of_a_policy_late_in_an_episode_is_found(made, tmp_path, number, name, rule):
    spec, row = spec_in(made.stored), number * 6 * STEPS + 17
    path = Path(shutil.copy(next((made.path / "data").iterdir()), tmp_path / "x.parquet"))
    right = made.table()[name][row].as_py()
    put(path, name, row, right - np.copysign(0.125, right))
    (problem,) = check_shard(spec, spec.shards[0], Storage(tmp_path), path.name)[1]
    assert (problem.rule, problem.row) == (rule, row)
