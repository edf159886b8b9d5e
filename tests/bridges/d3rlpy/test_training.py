"""d3rlpy learns a policy from the export, which is scored in the benchmark."""

from __future__ import annotations

from pathlib import Path

import d3rlpy
import numpy as np
import pytest
import torch
from d3rlpy.dataset import InfiniteBuffer, ReplayBuffer
from d3rlpy.logging import NoopAdapterFactory

import ibdata

CONFIGS = Path(__file__).parents[3] / "configs" / "siemens-offline"
HISTORY = 6  # the optimized policy looks five steps back


def fitted(config, folder: Path, source: str, steps: int):
    dataset = ibdata.generate(
        CONFIGS / f"{source}.yaml", folder / "data", workers=1, overrides=["episodes=10"]
    )
    ibdata.export(dataset, "d3rlpy", folder / "x.h5", history=HISTORY, view={"reward_scale": 0.01})
    with (folder / "x.h5").open("rb") as file:
        replay = ReplayBuffer.load(file, InfiniteBuffer())
    torch.set_num_threads(1)
    d3rlpy.seed(0)
    algorithm = config.create()
    algorithm.fit(
        replay,
        n_steps=steps,
        n_steps_per_epoch=steps,
        logger_adapter=NoopAdapterFactory(),
        show_progress=False,
    )
    return algorithm


def test_behaviour_cloning_gets_the_return_of_its_teacher(tmp_path):
    """The two differ by 11.6 (in hundreds) from random actions; the standard error is below 0.1."""
    scaler = d3rlpy.preprocessing.StandardObservationScaler()
    config = d3rlpy.algos.BCConfig(observation_scaler=scaler, batch_size=256, learning_rate=1e-3)
    cloned = fitted(config, tmp_path, "optimized-0", 2000)
    found = ibdata.evaluate(["optimized", "random", cloned], 70, history=HISTORY).results
    optimized, random, clone = (result.mean_return / 100 for result in found)
    assert random < optimized - 10
    assert abs(clone - optimized) < 1


@pytest.mark.parametrize(
    "config",
    [d3rlpy.algos.TD3PlusBCConfig, d3rlpy.algos.IQLConfig, d3rlpy.algos.CQLConfig],
    ids=lambda config: config.__name__,
)
def test_offline_algorithms_run(tmp_path, config):
    scaler = d3rlpy.preprocessing.StandardObservationScaler()
    learned = fitted(
        config(observation_scaler=scaler, gamma=0.97, batch_size=64), tmp_path, "optimized-40", 30
    )
    actions = learned.predict(np.zeros((5, 6 * HISTORY), np.float32))
    assert actions.shape == (5, 3)
    assert np.isfinite(actions).all()
