"""A dataset with all cases for an export, and a second, simple implementation of its transitions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import ibdata
from ibdata import Dataset, Experiment
from ibdata.exporters import FORMATS

OBSERVED = ("setpoint", "velocity", "gain", "shift", "fatigue", "consumption")
ELSEWHERE = ("minari",)  # tested where its library is, see tests/bridges
Plain = Callable[..., dict[str, Any]]


@pytest.fixture(params=[name for name in FORMATS if name not in ELSEWHERE])
def to(request) -> str:
    """A format."""
    return request.param


@pytest.fixture(scope="session")
def dataset(tmp_path_factory) -> Dataset:
    """12 episodes of 40 steps in 6 files; float64, so that exports have something to round."""
    experiment = Experiment.model_validate(
        {
            "name": "small",
            "setpoints": [20.0, 70.0],
            "policies": [{"kind": "random"}, {"kind": "safe"}],
            "episodes": 3,
            "steps": 40,
            "seed": 11,
            "output": {"latent": "next", "shard_rows": 80, "dtype": "float64"},
            "splits": {"source": {"setpoint": 20}, "target": {"setpoint": 70, "episodes": 2}},
        }
    )
    return ibdata.generate(experiment, tmp_path_factory.mktemp("exporters") / "small", workers=1)


@pytest.fixture(scope="session")
def plain(dataset) -> Plain:
    """Transitions row by row, from the words of the documentation."""

    def arrays(split: str | None = None, history: int = 1, scale: float = 1.0) -> dict[str, Any]:
        rows = dataset.table(split=split).to_pylist()
        now = [[row[f"obs_{x}"] for x in OBSERVED] for row in rows]
        after = [[row[f"next_obs_{x}"] for x in OBSERVED] for row in rows]
        observations, next_observations = [], []
        for i, row in enumerate(rows):
            frames = [now[i - min(lag, row["step"])] for lag in range(history)]
            observations.append([x for frame in frames for x in frame])
            next_observations.append([x for frame in [after[i], *frames[: history - 1]] for x in frame])
        return {
            "observations": np.float32(observations),
            "actions": np.float32([[row[f"act_{x}"] for x in ("velocity", "gain", "shift")] for row in rows]),
            "rewards": np.float32([float(np.float32(row["reward"])) * scale for row in rows]),
            "next_observations": np.float32(next_observations),
            "terminated": np.array([row["terminated"] for row in rows]),
            "truncated": np.array([row["truncated"] for row in rows]),
            "episode": np.array([row["episode"] for row in rows]),
            "step": np.array([row["step"] for row in rows], dtype=np.int32),
            "rows": rows,
        }

    return arrays
