"""RLlib trains on the export with the printed configuration."""

import gymnasium
import numpy as np
import pytest
import ray
from exporters.export_tests import ExportTests
from exporters.reading import RLLIB
from ray.rllib.algorithms.bc import BCConfig
from ray.rllib.algorithms.cql import CQLConfig
from ray.rllib.algorithms.marwil import MARWILConfig

import ibdata

pytestmark = pytest.mark.filterwarnings("ignore")  # Ray warns of itself


@pytest.fixture(scope="module", autouse=True)
def started():
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False, logging_level="ERROR")
    yield
    ray.shutdown()


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    experiment = {"name": "shown", "setpoints": 70, "policies": ["optimized"], "episodes": 2, "steps": 500}
    return ibdata.generate(experiment, tmp_path_factory.mktemp("rllib") / "shown", workers=1)


def losses(config, iterations):
    algorithm = config.build_algo()
    try:
        results = [algorithm.train() for _ in range(iterations)]
        return [float(result["learners"]["default_policy"]["policy_loss"]) for result in results]
    finally:
        algorithm.stop()


class TestRay(ExportTests):
    """Ray Data reads the columns that the printed configuration names."""

    format = "rllib"

    def read(self, made):
        rows = ray.data.read_parquet(made.path).to_pandas().sort_values(["episode", "step"])
        lists = [name for name in rows if name in RLLIB and name != "reward"]  # of Python's floats
        vectors = {name: np.stack(rows[name]).astype(np.float32) for name in lists}
        columns = {name: rows[name].to_numpy() for name in rows} | vectors
        return {RLLIB.get(name, name): array for name, array in columns.items()}


ID = "ibdata.environment:ibdata/IndustrialBenchmark-v0"
RATES = {"lr": None, "actor_lr": 1e-3, "critic_lr": 1e-3, "alpha_lr": 1e-3}  # of CQL, as the page says


@pytest.mark.parametrize(("kind", "iterations"), [(BCConfig, 20), (MARWILConfig, 2), (CQLConfig, 2)])
def test_algorithms_run_on_the_printed_configuration(shown, tmp_path, kind, iterations):
    made = ibdata.export(shown, "rllib", tmp_path / "made", view={"reward_scale": 0.01})
    box = gymnasium.spaces.Box
    config = kind().environment(
        observation_space=box(-np.inf, np.inf, (6,), np.float32), action_space=box(-1, 1, (3,), np.float32)
    )
    rates = {"lr": 1e-3}
    if kind is CQLConfig:
        config, rates = kind().environment(ID, env_config={"setpoint": 70}), RATES
    names = {"config": config.training(train_batch_size_per_learner=128, **rates).debugging(seed=0)}
    exec(made.snippet, names)
    found = losses(names["config"], iterations)
    assert np.isfinite(found).all()
    if kind is BCConfig:
        assert np.mean(found[-5:]) < np.mean(found[:5]) - 1


def test_the_snippet_of_the_page(use_with):
    (names,) = use_with("RLlib")
    names["algorithm"].stop()
    assert [result.policy for result in names["scores"].results] == ["bc", "optimized"]
