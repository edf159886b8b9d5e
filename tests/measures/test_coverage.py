"""State-action coverage and the stochasticity of actions, worked by hand."""

from __future__ import annotations

import numpy as np
import pytest

from ibdata.dynamics import Noise, initial_state, step
from ibdata.measures import (
    PAIRS,
    STATES,
    Coverage,
    Stochasticity,
    action_entropy,
    pair_numbers,
    state_numbers,
    steered,
)

ONE = np.array([1])


def test_each_interval_has_its_number():
    """Setpoints in 5, velocity, gain and shift in 10; 100 belongs to the last interval of these."""
    rows = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 9.9], [0.0, 0.0, 10.0], [0.0, 100.0, 0.0], [25.0, 0.0, 0.0]])
    assert state_numbers(np.zeros(5), rows).tolist() == [0, 0, 1, 90, 200]
    assert state_numbers([4.9, 5.0, 100.0], np.zeros((3, 3))).tolist() == [0, 1000, 20_000]
    assert state_numbers([100.0], [[100.0, 100.0, 100.0]]) == STATES - 1


def test_actions_have_five_intervals_each():
    actions = np.array([[-1.0, -1.0, -1.0], [-1.0, -1.0, -0.59], [-1.0, 0.0, -1.0], [0.3, -1.0, -1.0]])
    assert pair_numbers(np.zeros(4, dtype=np.int64), actions).tolist() == [0, 1, 2 * 5, 3 * 25]
    assert pair_numbers(np.array([STATES - 1]), [[1.0, 1.0, 1.0]]) == PAIRS - 1


def test_steering_is_that_of_the_dynamics():
    rng = np.random.default_rng(0)
    lengths = np.array([30, 7])
    actions, start = rng.uniform(-1, 1, (37, 3)), np.array([[99.0, 3.0, 50.0], [0.5, 95.0, 99.0]])
    found = steered(start, actions, lengths)
    for own, begun in ((slice(0, 30), start[0]), (slice(30, 37), start[1])):
        state = initial_state(70.0, *begun)
        for row, action in zip(found[own], actions[own], strict=True):
            np.testing.assert_allclose(row, [state.velocity[0], state.gain[0], state.shift[0]], rtol=1e-15)
            state = step(state, action[None], Noise(*np.zeros((len(Noise._fields), 1))))


def test_a_pair_of_state_and_action_counts_once():
    found = Coverage()
    state, still = np.full((1, 3), 50.0), np.zeros((1, 3))
    found.add(np.array([70.0]), state, still, ONE)
    found.add(np.array([71.0]), state + 1.0, still, ONE)
    assert found.pairs[0] == 1
    found.add(np.array([75.0]), state, still, ONE)
    found.add(np.array([70.0]), state, still + 0.5, ONE)
    assert found.pairs[0] == 3
    assert found.pairs[1] > 3


def test_it_is_the_mean_standard_deviation_of_the_cells():
    """Cell 3: half ±1 in velocity only. Cell 8: twice as many rows, and no spread."""
    found = Stochasticity()
    moving = np.zeros((10, 3))
    moving[:, 0] = [1, -1] * 5
    found.add(np.full(10, 3), moving)
    found.add(np.full(20, 8), np.full((20, 3), 0.25))
    in_cell_3 = np.sqrt(10 / 9) / 3  # of velocity, gain and shift: √(10/9), 0, 0
    assert found.value == pytest.approx(in_cell_3 * 10 / 30)


def test_entropy_is_the_mean_of_minus_the_log_density():
    """Half of the actions are the deterministic policy's, with mass ½; the others have density ½ · 1/8."""
    log_prob = np.log(np.array([0.5, 0.5, 1 / 16, 1 / 16], dtype=np.float32))
    assert action_entropy(log_prob) == pytest.approx((np.log(2) + np.log(16)) / 2, rel=1e-6)
    assert action_entropy(np.zeros(3)) == 0.0
    assert np.isnan(action_entropy(np.array([0.0, np.nan])))
