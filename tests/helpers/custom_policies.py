"""Custom policies of a module `mine`, and experiments with them."""

from __future__ import annotations

import textwrap

from ibdata import Experiment

CODE = textwrap.dedent("""
    import numpy as np

    open("imported", "w").close()

    class Actor:
        def __init__(self, gain=0.0):
            self.gain = gain

        def act(self, history, u):
            return self.gain * (2.0 * u - 1.0) + 0.001 * history[:, 0, 1:4]

    class Learned:
        def predict(self, observations):
            return np.tanh(observations[:, 7:10] / 100.0), None

    def made(value):
        return type("Still", (), {"predict": lambda self, x: np.full((len(x), 3), value)})()

    def still(observations, value=0.125):
        return np.full((len(observations), 3), value)

    def by_name(obs):
        return still(obs)

    actor = Actor(0.25)
    nothing = object()

    def failing():
        raise RuntimeError("no weights")

    calls = []

    def counting(observations):
        calls.append(0)
        return still(observations, len(calls) / 1000.0)
""")

PLAIN = {"name": "x", "setpoints": 70}


def described(**policy):
    return Experiment.model_validate(
        {
            "name": "own",
            "setpoints": [20.0, 70.0],
            "policies": [{"kind": "custom", **policy}],
            "steps": 4,
            "output": {"shard_rows": 4},
        }
    )
