"""A packed state is the state: every field in its place, and in the same memory."""

import numpy as np

from ibdata.dynamics.state import initial_state
from ibdata.simulation.packed import _views, packed


def test_a_state_comes_back_as_it_was_and_shares_the_memory_of_the_packed_one():
    state = initial_state(np.arange(5.0))
    for number, field in enumerate(state):
        field[:] = np.arange(field.size).reshape(field.shape) + 100 * number
    small = packed(state)
    again = _views(small)
    for name in state._fields:
        np.testing.assert_array_equal(getattr(again, name), getattr(state, name))
        assert getattr(again, name).dtype == getattr(state, name).dtype
        getattr(again, name)[:] = -1
    assert all((part == -1).all() for part in small)
    assert not any((field == -1).any() for field in state)
