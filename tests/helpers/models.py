"""Stand-ins for models of other libraries: modules of torch, and Stable-Baselines3 with its environments."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from ibdata.views.options import PLAIN


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
        return None

    def predict(self, observations, deterministic=False):
        weight = self.policy.action_net.weight.numpy()
        return np.clip(observations @ weight.T, -1.0, 1.0), None
