"""Errors of `step`, with the place, the found value and the expected one."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import tape

from ibdata.dynamics import Noise, State, initial_state, step
from ibdata.dynamics.state import FIELDS

INTEGERS = {"domain", "response", "direction", "drift_left"}
BAD_ACTIONS = [
    (np.zeros(3), r"step: action: found shape \(3,\), expected \(2, 3\)"),
    (np.zeros((3, 2)), r"step: action: found shape \(3, 2\), expected \(2, 3\)"),
    (np.zeros((1, 3)), r"step: action: found shape \(1, 3\), expected \(2, 3\)"),
    (
        [[0.0, 0.0, 0.0], [0.0, np.nan, 1.0]],
        r"step: action: found \[ 0. nan  1.\] in lane 1, expected finite",
    ),
    (
        [[np.inf, 0.0, 0.0], [0.0, 0.0, 1.0]],
        r"step: action: found \[inf  0.  0.\] in lane 0, expected finite",
    ),
]


@pytest.fixture
def noise():
    return tape.noise(np.random.default_rng(0), 2)


@pytest.fixture
def state(noise):
    return step(initial_state([20.0, 80.0]), np.zeros((2, 3)), noise)


@pytest.mark.parametrize(("action", "message"), BAD_ACTIONS)
def test_an_action_that_is_not_finite_or_of_another_shape_is_refused(state, noise, action, message):
    with pytest.raises(ValueError, match=message):
        step(state, action, noise)


@pytest.mark.parametrize("name", Noise._fields)
@pytest.mark.parametrize("wrong", [[0.5], [0.5, 0.5, 0.5], 0.5, [[0.5], [0.5]], [0.5, np.nan], [np.inf, 0.5]])
def test_noise_that_is_not_finite_or_of_another_shape_is_refused(state, noise, name, wrong):
    with pytest.raises(
        ValueError, match=rf"(?s)step: noise.{name}: found .*, expected 2 numbers of (Exp|U|N)\("
    ):
        step(state, np.zeros((2, 3)), noise._replace(**{name: np.array(wrong)}))


@pytest.mark.parametrize("name", Noise._fields)
def test_noise_beyond_the_range_of_its_distribution_is_refused(state, noise, name):
    low, high = {"exp": (0.0, 745.2), "normal": (-40.0, 40.0)}.get(name.split("_")[0], (0.0, 1.0 - 2.0**-53))
    for value in (np.nextafter(low, -np.inf), np.nextafter(high, np.inf)):
        with pytest.raises(
            ValueError, match=rf"(?s)step: noise.{name}: found .*, expected 2 numbers of (Exp|U|N)\("
        ):
            step(state, np.zeros((2, 3)), noise._replace(**{name: np.array([0.5, value])}))
    for value in (low, high):
        step(state, np.zeros((2, 3)), noise._replace(**{name: np.array([0.5, value])}))


@pytest.mark.parametrize("name", FIELDS)
def test_a_state_field_of_another_length_is_refused(state, name):
    with pytest.raises(ValueError, match=rf"(?s)state.{name}: found .*, expected \(2,"):
        state.replace(**{name: getattr(state, name)[:1]})


@pytest.mark.parametrize("part", ["floats", "integers"])
def test_a_state_of_other_arrays_is_refused(state, noise, part):
    parts = state._asdict()
    for wrong in (parts[part][:-1], parts[part][:, :1]):
        with pytest.raises(ValueError, match=r"step: state: found shapes .*, expected "):
            step(State(**(parts | {part: wrong})), np.zeros((2, 3)), noise)


def test_a_state_says_which_variables_it_has(state):
    with pytest.raises(AttributeError, match=r"no variable 'speed'; it has setpoint, velocity, .*"):
        _ = state.speed


@pytest.mark.parametrize("name", [name for name in FIELDS if name not in INTEGERS])
@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_a_state_that_is_not_finite_is_refused(state, noise, name, wrong):
    getattr(state, name)[1] = wrong
    with pytest.raises(ValueError, match=rf"(?s)step: state.{name}: found .*, expected numbers in"):
        step(state, np.zeros((2, 3)), noise)


OUT_OF_RANGE = [
    ("setpoint", -0.1),
    ("setpoint", 100.1),
    ("velocity", 1e9),
    ("operational_cost", -1.0),
    ("domain", 2),
    ("response", -2),
    ("direction", -7),
    ("direction", 7),
    ("direction", -(2**63)),
    ("mu_v", -0.1),
    ("mu_g", 5.1),
    ("drift_rate", 1e300),
    ("drift_left", -2),
]


@pytest.mark.parametrize(("name", "wrong"), OUT_OF_RANGE)
def test_a_state_out_of_its_range_is_refused(state, noise, name, wrong):
    getattr(state, name)[1] = wrong
    with pytest.raises(ValueError, match=rf"(?s)step: state.{name}: found .*, expected numbers in \["):
        step(state, np.zeros((2, 3)), noise)


@pytest.mark.parametrize("name", sorted(INTEGERS))
@pytest.mark.parametrize("wrong", [0.5, np.nan])
def test_a_whole_number_of_the_state_that_is_none_is_refused(state, name, wrong):
    field = getattr(state, name).astype(np.float64)
    field[1] = wrong
    with pytest.raises(ValueError, match=rf"(?s)state.{name}: found .*, expected whole numbers"):
        state.replace(**{name: field})


def test_a_name_that_is_no_variant_is_refused(state, noise):
    with pytest.raises(
        ValueError, match="variant: found 'java', expected one of siemens, paper or a Variant"
    ):
        step(state, np.zeros((2, 3)), noise, "java")
