"""The settings of an environment, and the errors for invalid ones."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from ibdata.dynamics import PAPER, SIEMENS, VARIANTS, Noise, initial_state, step
from ibdata.environment.settings import (
    consumption_bounds,
    frame_bounds,
    settings,
)
from ibdata.errors import UsageError

WRONG = {
    "setpoint": {
        101: "found 101, expected a number of at most 100",
        "drift": "found 'drift', expected a number, a list, {start, stop, step} or drifting; "
        "did you mean 'drifting'?",
        (10, 20): "found (10, 20), expected one, or one that moves",
    },
    "dynamics": {"simens": "found 'simens', expected one of siemens, paper; did you mean 'siemens'?"},
    "start": {"anywhere": "found 'anywhere', expected one of default, uniform"},
    "history": {
        0: "found 0, expected a whole number of at least 1",
        True: "found True, expected a whole number of at least 1",
    },
}


@pytest.mark.parametrize(("name", "value"), [(name, value) for name in WRONG for value in WRONG[name]])
def test_a_setting_that_cannot_be_meant_is_named_with_what_was_expected(name, value):
    with pytest.raises(UsageError) as caught:
        settings(**{name: value})
    assert str(caught.value) == f"{name}: {WRONG[name][value]}"


@pytest.mark.parametrize(
    ("setpoint", "first", "drifting"),
    [
        (70, 70.0, False),
        (np.int64(70), 70.0, False),
        ("drifting", 50.0, True),
        ({"drifting": 10}, 10.0, True),
    ],
)
def test_setpoints_are_numbers_or_move(setpoint, first, drifting):
    given = settings(setpoint=setpoint)
    assert (given.setpoint, given.world.drifting) == (first, drifting)


@pytest.mark.parametrize(
    ("dynamics", "variant"),
    [
        ("paper", PAPER),
        ({"base": "paper", "eta_mean": 0.1}, dataclasses.replace(PAPER, eta_mean=0.1)),
        (dataclasses.replace(SIEMENS, drift_length=7), dataclasses.replace(SIEMENS, drift_length=7)),
    ],
    ids=["name", "mapping", "Variant"],
)
def test_dynamics_are_a_name_a_mapping_or_a_variant(dynamics, variant):
    assert settings(dynamics=dynamics).world.variant == variant


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_extremes_of_consumption_are_within_its_bounds_and_near_them(variant):
    """The dearest and the cheapest steerings, the worst and the best of m, the normal draw at its ends."""
    low, high = consumption_bounds(VARIANTS[variant])
    seen = []
    for p, v, g, turns in ((100.0, 100.0, 100.0, 40), (0.0, 0.0, 0.0, 5)):
        for z in (-8.2, 8.2):
            state = initial_state(p, v, g, 100.0 if turns == 40 else 50.0)
            noise = Noise(*(np.zeros(1) for _ in Noise._fields))._replace(normal_consumption=np.array([z]))
            for _ in range(turns):
                state = step(state, [[0.0, 0.0, 1.0]], noise, variant)
                seen.append(state.consumption[0])
    assert low <= min(seen)
    assert max(seen) <= high
    assert max(seen) > 0.97 * high
    assert min(seen) < low + 30.0


def test_an_observation_s_bounds_are_those_of_the_columns():
    low, high = frame_bounds(settings(dynamics=SIEMENS))
    assert low[:5] == [0, 0, 0, 0, 0]
    assert high[:5] == [100, 100, 100, 100, 300]
    assert (round(low[5], 2), round(high[5], 1)) == (-7.28, 5183.2)
