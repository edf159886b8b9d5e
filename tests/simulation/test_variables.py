"""The columns of a dataset: names, order, types, roles, and bounds that generated values keep."""

from __future__ import annotations

import numpy as np
import pytest

from ibdata.experiment import Experiment
from ibdata.experiment.columns import columns
from ibdata.experiment.rollout import rollout
from ibdata.policies import OBSERVATION as OBSERVED
from ibdata.variables import VARIABLES, of_role

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

drifting = pytest.mark.parametrize("drifting", [False, True], ids=["constant", "moving"])
latent = pytest.mark.parametrize("latent", [False, True, "full", "next"])


def described(latent, drifting, dtype="float32", **changes):
    plain = {
        "name": "tested",
        "setpoints": {"drifting": [0.0, 50.0, 100.0]} if drifting else [0.0, 50.0, 100.0],
        "policies": [{"kind": "random"}],
        "output": {"latent": latent, "dtype": dtype},
    }
    return Experiment.model_validate({**plain, **changes})


@drifting
@latent
def test_the_names_and_their_order_follow_the_latent_setting(latent, drifting):
    hidden = [*HIDDEN, *(MOVING if drifting else [])] if latent else []
    expected = [
        *(name for role in list(ROLES)[:6] for name in ROLES[role]),
        *(f"latent_{name}" for name in hidden),
        *(f"latent_{name}" for name in DERIVED if latent == "full"),
        *(f"next_latent_{name}" for name in hidden if latent == "next"),
        "policy",
        "action_log_prob",
    ]
    assert [column.name for column in columns(described(latent, drifting))] == expected


@drifting
@latent
def test_the_role_of_a_column_is_that_of_its_group(latent, drifting):
    for column in columns(described(latent, drifting)):
        known = [role for role, names in ROLES.items() if column.name in names]
        assert [column.role] == (known or ["latent" if column.name.startswith("latent_") else "next_latent"])


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@latent
def test_all_but_indices_flags_and_texts_have_the_type_of_the_output(latent, dtype):
    for column in columns(described(latent, True, dtype)):
        assert column.dtype == TYPES.get(column.name, dtype)


@drifting
@latent
def test_every_column_has_a_meaning_a_unit_and_a_name_of_its_own(latent, drifting):
    made = columns(described(latent, drifting))
    assert len({column.name for column in made}) == len(made)
    for column in made:
        assert len(column.description) > 8
        assert column.unit in ("1", "cost", "1/step", "steps")
        assert column.low is None or column.high is None or column.low < column.high


def test_values_at_two_moments_are_described_as_such():
    described_as = {column.name: column.description for column in columns(described("next", True))}
    for name in described_as:
        if name.startswith("next_"):
            assert described_as[name].endswith("at t + 1")
            assert described_as[name.removeprefix("next_")].endswith("at t")


def test_the_variables_that_policies_observe_are_the_first_of_the_table():
    assert tuple(VARIABLES)[: len(OBSERVED)] == of_role("observation") == OBSERVED


def test_a_column_knows_its_variable_and_whether_it_is_taken_later():
    by_name = {column.name: column for column in columns(described("next", True))}
    for name in ("obs_gain", "latent_mu_v", "latent_theta_3"):
        now, after = by_name[name], by_name[f"next_{name}"]
        assert now.variable == after.variable == name.partition("_")[2]
        assert (now.later, after.later) == (False, True)
    assert (by_name["reward"].variable, by_name["reward"].later) == ("reward", True)
    assert by_name["act_gain"].variable is by_name["policy"].variable is None


def test_a_lag_is_the_number_of_steps_that_its_description_says():
    assert VARIABLES["theta_1"].meaning.endswith(", 1 step ago")
    assert VARIABLES["theta_9"].meaning.endswith(", 9 steps ago")


@pytest.mark.parametrize("start", ["default", "uniform"])
@pytest.mark.parametrize("dynamics", ["siemens", "paper"])
@drifting
def test_generated_values_keep_the_documented_bounds(drifting, dynamics, start):
    """Policies that push the steerings to both ends reach the ends of most ranges."""
    ends = [[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [0.0, 0.0, 0.3]]
    policies = [{"kind": "random"}, *({"kind": "constant", "action": action} for action in ends)]
    for setting in ("full", "next"):
        experiment = described(
            setting, drifting, dynamics=dynamics, start=start, policies=policies, episodes=4, steps=150
        )
        made = rollout(experiment, 0, 4 * len(experiment.cells))
        bounds = {column.name: (column.low, column.high) for column in columns(experiment)}
        for name, values in zip(made.names, made.table, strict=True):
            low, high = bounds[name]
            assert np.isfinite(values).all(), name
            assert low is None or values.min() >= low, (name, values.min())
            assert high is None or values.max() <= high, (name, values.max())


def test_the_documented_bounds_are_reached_where_they_are_meant_to_be():
    experiment = described(
        "full", False, start="uniform", episodes=20, steps=150,
        policies=[{"kind": "constant", "action": [sign, sign, sign]} for sign in (-1.0, 1.0)],
    )  # fmt: skip
    made = rollout(experiment, 0, 20 * len(experiment.cells))
    columns_by_name = {column.name: column for column in columns(experiment)}
    for name in ("obs_setpoint", "obs_velocity", "obs_gain", "obs_shift", "latent_domain", "latent_response"):
        values = made.table[made.names.index(name)]
        assert (values.min(), values.max()) == (columns_by_name[name].low, columns_by_name[name].high)
