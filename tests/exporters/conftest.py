"""A dataset with all cases for an export."""

import pytest

import ibdata
from ibdata.exporters import FORMATS

ELSEWHERE = ("minari",)  # tested where its library is, see tests/bridges


@pytest.fixture(params=[name for name in FORMATS if name not in ELSEWHERE])
def to(request):
    """A format."""
    return request.param


@pytest.fixture(scope="session")
def dataset(tmp_path_factory):
    """12 episodes of 40 steps in 6 files; float64, so that exports have something to round."""
    experiment = {
        "name": "small",
        "setpoints": [20.0, 70.0],
        "policies": ["random", "safe"],
        "episodes": 3,
        "steps": 40,
        "seed": 11,
        "output": {"latent": "next", "shard_rows": 80, "dtype": "float64"},
        "splits": {"source": {"setpoint": 20}, "target": {"setpoint": 70, "episodes": 2}},
    }
    return ibdata.generate(experiment, tmp_path_factory.mktemp("exporters") / "small", workers=1)
