"""Errors of `initial_state` and `step`, with the place, the found value and the expected one."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import tape

from ibdata.dynamics import Noise, State, initial_state, step
from ibdata.dynamics.state import FIELDS
from ibdata.views.variables import rows

INTEGERS = {"domain", "response", "direction", "drift_left"}
NAN, INF = np.nan, np.inf
ZERO = np.zeros((2, 3))
BAD_ACTIONS = [
    (np.zeros(3), r"found shape \(3,\), expected \(2, 3\)"),
    (np.zeros((1, 3)), r"found shape \(1, 3\), expected \(2, 3\)"),
    ([[0.0, 0.0, 0.0], [0.0, NAN, 1.0]], r"found \[ 0. nan  1.\] in lane 1, expected finite"),
    ([[INF, 0.0, 0.0], [0.0, 0.0, 1.0]], r"found \[inf  0.  0.\] in lane 0, expected finite"),
]
BAD_STATES = [
    *((name, NAN) for name in FIELDS if name not in INTEGERS),
    *(("setpoint", -0.1), ("setpoint", 100.1), ("velocity", INF), ("operational_cost", -1.0)),
    *(("domain", 2), ("response", -2), ("direction", 7), ("direction", -(2**63)), ("drift_left", -2)),
    *(("mu_v", -0.1), ("mu_g", 5.1), ("drift_rate", 1e300)),
]
BAD_STARTS = [
    ({"setpoint": 100.5}, r"setpoint: found 100.5, expected numbers in \[0, 100\]"),
    ({"setpoint": NAN}, r"setpoint: found nan, expected numbers in \[0, 100\]"),
    ({"setpoint": 50.0, "gain": [1.0, 101.0]}, r"gain: found \[  1. 101.\], expected numbers in"),
    ({"setpoint": [[50.0]]}, r"setpoint: found shape \(1, 1\), expected a number or \(n,\)"),
    ({"setpoint": [1.0, 2.0], "gain": [1.0, 2.0, 3.0]}, r"found setpoint \(2,\), velocity \(\), gain \(3,\)"),
]


@pytest.fixture
def noise():
    return tape.noise(np.random.default_rng(0), 2)


@pytest.fixture
def state(noise):
    return step(initial_state([20.0, 80.0]), ZERO, noise)


def test_a_start_or_an_action_out_of_range_or_shape_is_refused(state, noise):
    for arguments, message in BAD_STARTS:
        with pytest.raises(ValueError, match=f"^initial_state: {message}"):
            initial_state(**arguments)
    for action, message in BAD_ACTIONS:
        with pytest.raises(ValueError, match=f"^step: action: {message}"):
            step(state, action, noise)


@pytest.mark.parametrize("name", Noise._fields)
def test_noise_of_another_shape_or_law_is_refused(state, noise, name):
    low, high = {"exp": (0.0, 745.2), "normal": (-40.0, 40.0)}.get(name.split("_")[0], (0.0, 1.0 - 2.0**-53))
    outside = ([0.5, np.nextafter(low, -INF)], [0.5, np.nextafter(high, INF)], [0.5, NAN])
    for wrong in ([0.5], [[0.5], [0.5]], *outside):
        message = rf"(?s)^step: noise.{name}: found .*, expected 2 numbers of (Exp|U|N)\("
        with pytest.raises(ValueError, match=message):
            step(state, ZERO, noise._replace(**{name: np.array(wrong)}))
    step(state, ZERO, noise._replace(**{name: np.array([low, high])}))


def test_a_state_out_of_its_range_or_of_another_shape_is_refused(state, noise):
    for name, wrong in BAD_STATES:
        other = State(state.values.copy())
        other.values[rows("theta_0" if name == "operational_cost" else name)[0], 1] = wrong
        with pytest.raises(ValueError, match=rf"(?s)^step: state.{name}: found .*, expected numbers in \["):
            step(other, ZERO, noise)
    with pytest.raises(ValueError, match=r"^step: state: found shape \(31, 2\), expected \(32, lanes\)"):
        step(State(state.values[:-1]), ZERO, noise)
    with pytest.raises(ValueError, match=r"^step: action: found shape \(2, 3\), expected \(1, 3\)"):
        step(State(state.values[:, :1]), ZERO, noise)
