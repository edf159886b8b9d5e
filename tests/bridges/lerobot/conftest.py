"""LeRobot and TorchRL without a network, and without a cache of the user's."""

import os
import tempfile

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
