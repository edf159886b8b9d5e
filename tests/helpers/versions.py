"""A custom policy with a helper module, and what it gets."""

from __future__ import annotations

import ibdata

POLICY = """
import numpy as np

def act(history, u):
    from size_of_version import SIZE
    return np.full((len(history), 3), SIZE)

class Own:
    def act(self, history, u):
        return act(history, u)
"""


def evaluated(*policies):
    return ibdata.evaluate(list(policies), allow_code=True, episodes=3, steps=4, setpoint=70).returns[:, 0]


def constant(size):
    """The returns of a policy that always takes one action."""
    return evaluated({"kind": "constant", "action": [size] * 3})[0]
