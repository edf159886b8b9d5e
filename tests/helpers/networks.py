"""Small networks with random weights."""

from __future__ import annotations

import json
from itertools import pairwise

import numpy as np

from ibdata.policies.weights_file import written

MEAN, STD = [55.0, 49.0, 50.5, 49.5, 37.5, 166.0], [28.0, 12.0, 30.0, 29.0, 31.0, 139.0]


def tensors(frames=2, hidden=(8, 5), log_std=True, seed=0):
    """The tensors of a network by name."""
    rng = np.random.default_rng(seed)
    sizes = [6 * frames, *hidden]
    named = {}
    for i, (inputs, outputs) in enumerate(pairwise(sizes)):
        named |= _layer(rng, f"layers.{i}", outputs, inputs)
    named |= _layer(rng, "mean", 3, sizes[-1])
    return {**named, **_layer(rng, "log_std", 3, sizes[-1])} if log_std else named


def metadata(frames=2, **changes):
    """The metadata of a network, as texts; without those that are None."""
    plain = {
        "layout": "ibdata-network-1",
        "frames": str(frames),
        "mean": json.dumps(MEAN),
        "std": json.dumps(STD),
        "clip": "10",
        "squash": "tanh",
        **changes,
    }
    return {key: value for key, value in plain.items() if value is not None}


def weights(frames=2, hidden=(8, 5), log_std=True, seed=0, **changes):
    """The bytes of a file of weights."""
    return written(tensors(frames, hidden, log_std, seed), metadata(frames, **changes))


def _layer(rng, name, outputs, inputs):
    scale = inputs**-0.5
    return {
        f"{name}.weight": (scale * rng.standard_normal((outputs, inputs))).astype(np.float32),
        f"{name}.bias": (0.3 * rng.standard_normal(outputs)).astype(np.float32),
    }
