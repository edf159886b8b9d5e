"""A dataset of twelve episodes, with two setpoints and the latent state of t + 1."""

import pytest

import ibdata
from ibdata import Dataset


@pytest.fixture(scope="session")
def dataset(tmp_path_factory) -> Dataset:
    experiment = ibdata.Experiment.model_validate(
        {
            "name": "small",
            "setpoints": [20, 70],
            "policies": [{"kind": "random"}, {"kind": "safe"}],
            "episodes": 3,
            "steps": 25,
            "seed": 11,
            "output": {"latent": "next", "shard_rows": 50},
            "splits": {"source": {"setpoint": 20}, "target": {"setpoint": 70, "episodes": 2}},
        }
    )
    return ibdata.generate(experiment, tmp_path_factory.mktemp("bridge") / "small", workers=1)


@pytest.fixture
def root(tmp_path, monkeypatch):
    """Minari's root, and nothing of the user's."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "root"))
    return tmp_path / "root"
