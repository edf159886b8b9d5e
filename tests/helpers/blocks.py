"""Blocks of policies of every kind, and around every kind of base."""

from __future__ import annotations

import numpy as np

from helpers import networks
from ibdata.policies import POLICIES
from ibdata.policies.weights_file import written

BAD, SAFE, RANDOM = {"kind": "bad"}, {"kind": "safe"}, {"kind": "random"}
BASE = {"kind": "constant", "action": [0.5, -1.0, 0.1]}
CODE = {"kind": "custom", "target": "ibdata.policies.baselines:Safe", "uniforms": 5}  # code that everyone has
SURE = {"kind": "custom", "target": "ibdata.policies.baselines:Mediocre", "deterministic": True}
NETWORK = {"kind": "network", "file": "actor.safetensors"}  # see `actor`
NOISE = {"kind": "ornstein_uhlenbeck", "base": BASE, "theta": 0.5, "sigma": 0.6}
PINK = {"kind": "coloured_noise", "period": 8}
STICKY = {"kind": "sticky", "base": SAFE, "kappa": 0.4}
PLAIN = ["bad", "constant", "expert", "mediocre", "multisine", "optimized", "ornstein_uhlenbeck", "prbs"]
BLOCKS = [
    *({"kind": kind} for kind in [*PLAIN, "random", "safe"]),
    BASE,
    {"kind": "prbs", "order": 3, "hold": 1, "amplitude": 0.25},
    {"kind": "multisine", "sines": 2, "period": 16, "amplitude": 0.5},
    CODE,
    SURE,
    NETWORK,
    {"kind": "sampled", "base": NETWORK, "share": 0.4},
    {"kind": "sampled", "base": NETWORK, "share": 1.0},
    {"kind": "gaussian", "base": BASE, "scale": 0.6},
    {"kind": "gaussian", "base": SURE, "scale": 0.4},
    NOISE,
    PINK,
    {"kind": "coloured_noise", "base": BASE, "beta": 0.5, "scale": 2.0, "period": 2},
    {"kind": "epsilon_greedy", "base": BASE, "epsilon": 0.3},
    {"kind": "epsilon_greedy", "base": SAFE, "epsilon": 0.3},
    {"kind": "epsilon_greedy", "base": BASE, "epsilon": 1.0},
    {"kind": "epsilon_greedy", "base": SAFE, "epsilon": 0.0},
    {"kind": "epsilon_greedy", "base": SURE, "epsilon": 0.4},
    STICKY,
    {"kind": "sticky", "base": SURE, "kappa": 0.5},
    {"kind": "sticky", "base": {"kind": "epsilon_greedy", "base": BASE, "epsilon": 0.5}, "kappa": 0.4},
    {"kind": "sticky", "base": STICKY, "kappa": 0.5},
    {"kind": "mixture", "bases": [SAFE, BAD, RANDOM]},
    {"kind": "mixture", "bases": [BAD, {"kind": "sticky", "base": NOISE, "kappa": 0.5}]},
    {"kind": "mixture", "bases": [PINK, {"kind": "prbs"}], "weights": [1.0, 3.0]},
    {"kind": "schedule", "stages": [{"base": BASE, "steps": 10, "epsilon": [0.9, 0.1]}]},
    {"kind": "schedule", "stages": [{"base": STICKY, "steps": 10, "epsilon": [0.5, 0.5]}]},
    {"kind": "schedule", "stages": [{"base": BAD, "steps": 2}, {"base": SAFE}]},
]


def policy_of(block):
    """The policy of a block."""
    return POLICIES[block["kind"]](**{key: value for key, value in block.items() if key != "kind"})


def actor(mean=(0.3, -0.5, 0.2), log_std=(-1.0, -0.7, -0.9), varying=0.1, bounded_by="clamp", **texts):
    """The bytes of a network whose outputs depend little on what it sees."""
    tensors = networks.tensors(frames=1, hidden=(4,))
    for name, values in (("mean", mean), ("log_std", log_std)):
        tensors[f"{name}.bias"] = np.array(values, dtype=np.float32)
        tensors[f"{name}.weight"] *= np.float32(varying)
    return written(tensors, networks.metadata(1, log_std=bounded_by, **texts))
