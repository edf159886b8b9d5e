"""LeRobot and TorchRL without a network, and without a cache of the user's."""

import os
import tempfile

import pytest
import torch

# The libraries read these when they are imported.
CACHE = tempfile.TemporaryDirectory(prefix="ibdata-lerobot-")
os.environ.update(HF_HUB_OFFLINE="1", HF_HOME=CACHE.name, HF_HUB_DISABLE_TELEMETRY="1")

try:
    import torchvision  # noqa: F401
except RuntimeError:  # it is compiled for graphics cards; LeRobot imports it, and needs it for images only
    for name in ("nms", "qnms"):
        schema = "(Tensor dets, Tensor scores, float iou_threshold) -> Tensor"
        torch.library.define(f"torchvision::{name}", schema)


@pytest.fixture(scope="session")
def dataset(tmp_path_factory):
    """12 episodes of 40 steps at two setpoints."""
    import ibdata

    experiment = {
        "name": "small",
        "setpoints": [20, 70],
        "policies": ["random", "safe"],
        "episodes": 3,
        "steps": 40,
        "seed": 11,
        "output": {"latent": "next"},
        "splits": {"source": {"setpoint": 20}, "target": {"setpoint": 70, "episodes": 2}},
    }
    return ibdata.generate(experiment, tmp_path_factory.mktemp("bridge") / "small", workers=1)
