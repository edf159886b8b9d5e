"""Densities that depend on earlier steps are recomputed from the rows by replaying the episodes."""

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import ibdata
from ibdata.experiment import Experiment
from ibdata.experiment.columns import columns
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.validation.rows import check_shard
from ibdata.writing.arrow import writer_options

NOISE = {"kind": "ornstein_uhlenbeck", "base": {"kind": "optimized"}}
FADING = [{"base": {"kind": "bad"}, "steps": 7, "epsilon": [1.0, 0.0]}, {"base": NOISE}]
POLICIES = [
    NOISE,
    {"kind": "coloured_noise", "period": 16},
    {"kind": "sticky", "base": {"kind": "random"}, "kappa": 0.5},
    {"kind": "prbs"},
    {"kind": "multisine"},
    {"kind": "gaussian", "base": {"kind": "multisine"}, "scale": 0.1},
    {"kind": "mixture", "bases": [NOISE, {"kind": "safe"}, {"kind": "coloured_noise", "period": 4}]},
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


@pytest.mark.parametrize("number", [0, 2, 3, 6, 7])
def test_a_wrong_density_late_in_an_episode_is_found(made, tmp_path, number):
    experiment, dataset = made
    (shard,) = DatasetSpec.of(experiment).shards
    row = number * 6 * STEPS + 17
    table = dataset.read_shard(0)
    place = table.schema.get_field_index("action_log_prob")
    density = table["action_log_prob"].to_numpy().copy()
    density[row] -= 0.125
    table = table.set_column(place, table.schema.field(place), pa.array(density))
    pq.write_table(table, tmp_path / "x.parquet", **writer_options(columns(experiment)))
    (problem,) = check_shard(DatasetSpec.of(experiment), shard, tmp_path, "x.parquet")[1]
    assert (problem.rule, problem.row) == ("density", row)
