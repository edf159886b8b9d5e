"""The grid of state-action coverage and its reference, worked by hand."""

from __future__ import annotations

import numpy as np

from ibdata.dynamics import Noise, initial_state, step
from ibdata.measures.coverage import PAIRS, STATES, Coverage, pair_numbers, state_numbers, steered

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


def test_a_pair_counts_once_and_the_setpoint_and_the_action_tell_pairs_apart():
    found = Coverage()
    state, still = np.full((1, 3), 50.0), np.zeros((1, 3))
    found.add(np.array([70.0]), state, still, ONE)
    found.add(np.array([71.0]), state + 1.0, still, ONE)
    assert found.pairs[0] == 1
    found.add(np.array([75.0]), state, still, ONE)
    found.add(np.array([70.0]), state, still + 0.5, ONE)
    assert found.pairs[0] == 3
    assert found.pairs[1] > 3
