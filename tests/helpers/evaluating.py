"""Returns of a policy in a few short episodes."""

from __future__ import annotations

from ibdata import evaluate

NUDGE = {"kind": "constant", "action": [0.5, -1, 0.25]}


def returns(policy, setpoint=70.0, **settings):
    return evaluate(policy, setpoint, **{"steps": 30, "episodes": 4, **settings}).returns[0]
