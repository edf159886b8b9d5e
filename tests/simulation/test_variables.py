"""The columns of a dataset: names, order, types, roles, and bounds that generated values keep."""

from __future__ import annotations

import pytest

from ibdata.experiment import Experiment
from ibdata.plan.columns import columns

OBSERVATION = ["setpoint", "velocity", "gain", "shift", "fatigue", "consumption"]
HIDDEN = [*(f"theta_{lag}" for lag in range(1, 10)), "domain", "response", "direction", "mu_v", "mu_g"]
MOVING = ["drift_rate", "drift_left"]
DERIVED = [
    "convolved_cost", "penalty", "expected_consumption", "effective_shift", "effective_velocity",
    "effective_gain", "alpha", "basic_fatigue",
]  # fmt: skip
ROLES = {
    "index": ["episode", "step"],
    "observation": [f"obs_{name}" for name in OBSERVATION],
    "action": ["act_velocity", "act_gain", "act_shift"],
    "reward": ["reward"],
    "flag": ["terminated", "truncated"],
    "next_observation": [f"next_obs_{name}" for name in OBSERVATION],
    "policy": ["policy"],
    "log_prob": ["action_log_prob"],
}
TYPES = {
    "episode": "int64", "step": "int32", "terminated": "bool", "truncated": "bool", "policy": "string",
}  # fmt: skip


def described(latent, drifting, dtype="float32", **changes):
    plain = {
        "name": "tested",
        "setpoints": {"drifting": [0.0, 50.0, 100.0]} if drifting else [0.0, 50.0, 100.0],
        "policies": [{"kind": "random"}],
        "output": {"latent": latent, "dtype": dtype},
    }
    return Experiment.model_validate({**plain, **changes})


@pytest.mark.parametrize("drifting", [False, True], ids=["constant", "moving"])
@pytest.mark.parametrize("latent", [False, True, "full", "next"])
def test_names_roles_and_types_follow_the_output(latent, drifting):
    dtype = "float64" if latent == "next" else "float32"
    hidden = [*HIDDEN, *(MOVING if drifting else [])] if latent else []
    groups = dict(ROLES)
    last = {role: groups.pop(role) for role in ("policy", "log_prob")}
    groups["latent"] = [f"latent_{name}" for name in [*hidden, *(DERIVED if latent == "full" else [])]]
    groups["next_latent"] = [f"next_latent_{name}" for name in hidden if latent == "next"]
    expected = [
        (name, role, TYPES.get(name, dtype)) for role, names in {**groups, **last}.items() for name in names
    ]
    made = columns(described(latent, drifting, dtype))
    assert [(column.name, column.role, column.dtype) for column in made] == expected
