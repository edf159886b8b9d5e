"""Every rule finds the row that breaks it, in a file whose hash is correct; tests/corpus has more."""

import json
import os
import shutil

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from helpers.datasets import AS_WRITTEN
from helpers.folders import seal

import ibdata
import ibdata as library
from ibdata._system.storage import Storage
from ibdata.errors import BusyError
from ibdata.experiment import Experiment
from ibdata.experiment.columns import columns
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.generation.pieces import writer_options
from ibdata.tools.checks import check_shard
from ibdata.tools.validate import validate


@pytest.fixture
def shard(copied, shard_file):
    """The path of the shard that is damaged."""
    return shard_file(copied, 1)


@pytest.fixture
def change(copied):
    """Put values into a column of a Parquet file, and sign the file."""

    def put(path, name, row, value):
        table = pq.read_table(copied / path)
        values = table[name].to_pylist()
        values[row] = value
        index, field = table.column_names.index(name), table.schema.field(name)
        options = AS_WRITTEN if path.startswith("data") else {}
        changed = table.set_column(index, field, pa.array(values, field.type))
        pq.write_table(changed, copied / path, **options)
        seal(copied)

    return put


def rules(folder):
    return {(p.path, p.row, p.rule) for p in validate(folder)}


def test_a_dataset_that_was_just_made_is_valid(either):
    assert validate(either.path) == []
    assert validate(either.path, quick=True) == []


@pytest.mark.parametrize(
    ("name", "row", "value", "rule"),
    [
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
    ],
)
def test_a_broken_row_is_named_with_its_rule(copied, shard, change, name, row, value, rule):
    change(shard, name, row, value)
    assert (shard, row, rule) in rules(copied)


def test_many_broken_rows_are_one_problem_that_counts_them(copied, shard, change):
    change(shard, "obs_gain", slice(None), np.full(40, 101.0))
    (found,) = (p for p in validate(copied) if p.rule == "bounds" and p.message.startswith("obs_gain"))
    line = f"{shard}: row 0: bounds: obs_gain: found 101.0, expected at most 100 (40 such rows)"
    assert str(found) == line


def test_rows_that_keep_every_rule_but_are_others_are_named(copied, shard, change):
    """Nothing is said of a hidden value at the first step, but that it is the one that was listed."""
    change(shard, "latent_mu_v", 0, 0.25)
    assert rules(copied) >= {(shard, None, "digest"), ("meta/episodes.parquet", None, "metadata")}


def test_a_table_of_an_earlier_version_has_setpoints_in_float64(tmp_path):
    plain = {"name": "x", "setpoints": [20.1, 70.0], "policies": ["random"], "steps": 3}
    made = ibdata.generate(plain, tmp_path / "x", workers=1).path
    path = made / "meta/episodes.parquet"
    table = pq.read_table(path)
    place = table.column_names.index("setpoint")
    pq.write_table(table.set_column(place, "setpoint", pa.array([20.1, 70.0])), path)
    seal(made)
    assert validate(made) == []


@pytest.mark.parametrize(("key", "split"), [("mean", None), ("max", "target")])
def test_statistics_that_are_not_those_of_the_rows_are_named(copied, key, split):
    path = copied / "meta/statistics.json"
    stats = json.loads(path.read_bytes())
    (stats["all"] if split is None else stats["splits"][split])["reward"][key] += 1
    path.write_text(json.dumps(stats))
    seal(copied)
    (problem,) = validate(copied)
    assert (problem.path, problem.rule) == ("meta/statistics.json", "metadata")
    assert f"reward.{key}: found " in problem.message


@pytest.mark.parametrize("what", ["shard", "meta/statistics.json", "meta/experiment.yaml"])
def test_a_file_that_is_changed_or_missing_is_named(copied, shard, what):
    path = shard if what == "shard" else what
    data = bytearray((copied / path).read_bytes())
    data[len(data) // 2] ^= 1
    (copied / path).write_bytes(data)
    for quick in (True, False):  # of rows that are read while their file is hashed, nothing else is said
        assert [(p.path, p.rule) for p in validate(copied, quick)] == [(path, "hash")]
    (copied / path).unlink()
    assert [(p.path, p.rule) for p in validate(copied)] == [(path, "file")]


def pipe(path):
    path.unlink()
    os.mkfifo(path)


@pytest.mark.parametrize("damage", [os.unlink, pipe])
@pytest.mark.parametrize("quick", [False, True])
def test_a_missing_card_is_named_and_made_again(copied, damage, quick):
    text = (copied / "README.md").read_bytes()
    (copied / "README.md").write_text("edited")
    assert validate(copied, quick) == []
    damage(copied / "README.md")
    (problem,) = validate(copied, quick)
    assert (problem.path, problem.rule) == ("README.md", "file")
    assert problem.message.endswith("which load_dataset needs; ibdata repair makes it again")
    assert library.repair(copied, workers=1) == ["README.md"]
    assert (copied / "README.md").read_bytes() == text


@pytest.mark.parametrize("name", ["part-00099-1a2b3c4d.parquet", ".Part.PARQUET", ".h/x", ".h/"])
def test_files_and_folders_that_are_not_listed_are_named(copied, shard, name):
    path = copied / "data" / name
    if name.endswith("/"):
        path.mkdir()
    else:
        path.parent.mkdir(exist_ok=True)
        shutil.copy(copied / shard, path)
    (copied / "data/.DS_Store").write_text("no reader takes it")
    (problem,) = validate(copied)
    assert (problem.path, problem.rule) == (f"data/{name.partition('/')[0]}", "file")
    assert "that the manifest does not list; move it away" in problem.message


@pytest.mark.slow
def test_a_dataset_of_symbolic_links_is_valid(copied, ibdata, tmp_path):
    """As Hugging Face's cache, DVC and git-annex keep what was downloaded."""
    blobs = tmp_path / "blobs"
    blobs.mkdir()
    links = [path for path in copied.rglob("*") if path.is_file()]
    for number, path in enumerate(links):
        path.rename(blobs / str(number))
        path.symlink_to(os.path.relpath(blobs / str(number), path.parent))
    assert validate(copied) == validate(copied, quick=True) == []
    assert library.repair(copied, workers=1) == []
    for command in ("validate", "repair"):
        done = ibdata(command, str(copied))
        assert (done.returncode, done.stderr) == (0, "")
    assert all(path.is_symlink() for path in links)


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
    experiment = Experiment.model_validate({**plain, "policies": POLICIES})
    return experiment, ibdata.generate(experiment, tmp_path_factory.mktemp("densities") / "x", workers=1)


def test_the_densities_of_every_policy_are_found_to_be_right(made):
    _, dataset = made
    assert ibdata.validate(dataset.path) == []
    assert ibdata.reproduce(dataset.path)[1] == []


@pytest.mark.parametrize("number", [0, 1, 2, 5, 6])
def test_a_wrong_density_late_in_an_episode_is_found(made, tmp_path, number):
    experiment, dataset = made
    (shard,) = DatasetSpec.of(experiment).shards
    row = number * 6 * STEPS + 17
    table = dataset.stored.rows(0)
    place = table.schema.get_field_index("action_log_prob")
    density = table["action_log_prob"].to_numpy().copy()
    density[row] -= 0.125
    table = table.set_column(place, table.schema.field(place), pa.array(density))
    pq.write_table(table, tmp_path / "x.parquet", **writer_options(columns(experiment)))
    (problem,) = check_shard(DatasetSpec.of(experiment), shard, Storage(tmp_path), "x.parquet")[1]
    assert (problem.rule, problem.row) == ("density", row)


def test_an_expert_s_action_that_is_another_is_found(tmp_path):
    plain = {
        "name": "x",
        "setpoints": 20,
        "policies": ["random"],
        "steps": 9,
        "output": {"expert_action": True},
    }
    dataset = ibdata.generate(plain, tmp_path / "x", workers=1)
    spec, table = DatasetSpec.of(ibdata.load(plain)), dataset.stored.rows(0)
    gain = table["expert_act_gain"].to_numpy().copy()
    gain[7] = 0.25
    place = table.schema.get_field_index("expert_act_gain")
    table = table.set_column(place, table.schema.field(place), pa.array(gain))
    pq.write_table(table, tmp_path / "x.parquet", **writer_options(columns(spec.experiments[0])))
    (problem,) = check_shard(spec, spec.shards[0], Storage(tmp_path), "x.parquet")[1]
    assert (problem.rule, problem.row) == ("expert action", 7)
