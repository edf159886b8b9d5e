"""Small networks with random weights, and stand-ins for the models of other libraries."""

from __future__ import annotations

import json
from itertools import pairwise
from types import SimpleNamespace

import numpy as np

from ibdata.policies.weights_file import written
from ibdata.views.options import PLAIN

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


class Linear:
    """A module as torch has them, of which a network is saved."""

    def __init__(self, weight):
        self.weight, self.bias = (Parameter(x) for x in (weight, np.zeros(len(weight), dtype=np.float32)))

    def named_modules(self, remove_duplicate=True):
        return [("", self)]

    def children(self):
        return []

    def __call__(self, x):
        return Parameter(x.numpy() @ self.weight.numpy().T)

    training = False

    def train(self, on):
        pass

    def modules(self):
        return [self]


class Parameter:
    def __init__(self, numbers):
        self.numpy = lambda: numbers

    def new_tensor(self, numbers):
        return Parameter(numbers)

    def detach(self):
        return self

    cpu = detach


class Environment:
    """An environment, or one that holds another as `env` or `venv`."""

    view = PLAIN

    def __init__(self, **inner):
        self.__dict__.update(inner)

    def get_attr(self, name, indices):
        return [getattr(self, name)]


def layers(*names, **inner):
    """An environment with these layers, outermost first, such as "gymnasium.TimeLimit"."""
    made = None
    for name in reversed(names):
        module, _, kind = name.rpartition(".")
        attribute = "venv" if kind.startswith("Vec") else "env"
        inner = inner if made is None else {attribute: made}
        made = type(kind, (Environment,), {"__module__": module})(**inner)
    return made


class Model:
    """A model of SB3 that was trained in an environment, with the layers of PPO."""

    action_space = SimpleNamespace(low=-np.ones(3), high=np.ones(3))
    observation_space = SimpleNamespace(shape=(6,))

    def __init__(self, env=None):
        self.env, net = env, Linear(np.full((3, 6), 0.001, dtype=np.float32))
        none = SimpleNamespace(named_modules=lambda remove_duplicate: [])
        self.policy = SimpleNamespace(
            pi_features_extractor=none,
            mlp_extractor=SimpleNamespace(policy_net=[]),
            action_net=net,
            log_std=Parameter(np.zeros(3)),
        )

    def get_env(self):
        return self.env

    def get_vec_normalize_env(self):
        return getattr(self.env, "normalize", None)

    def predict(self, observations, deterministic=False):
        weight = self.policy.action_net.weight.numpy()
        return np.clip(observations @ weight.T, -1.0, 1.0), None


def actor(mean=(0.3, -0.5, 0.2), log_std=(-1.0, -0.7, -0.9), varying=0.1, bounded_by="clamp", **texts):
    """The bytes of a network whose outputs depend little on what it sees."""
    named = tensors(frames=1, hidden=(4,))
    for name, values in (("mean", mean), ("log_std", log_std)):
        named[f"{name}.bias"] = np.array(values, dtype=np.float32)
        named[f"{name}.weight"] *= np.float32(varying)
    return written(named, metadata(1, log_std=bounded_by, **texts))
