"""A state in three arrays: what enters compiled code costs by the array, and a State has 23."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ibdata.dynamics.state import Floats, Ints, State
from ibdata.numerics.compiled import compiled


class Packed(NamedTuple):
    """The arrays of a State side by side."""

    floats: Floats  # (18, n)
    operational_cost: Floats  # (n, 10)
    integers: Ints  # (4, n)


def _views(packed: Packed) -> State:
    """The State whose arrays are those of the packed one."""
    x, z = packed.floats, packed.integers
    return State(
        x[0], x[1], x[2], x[3], x[4], x[5], x[6], packed.operational_cost, z[0], z[1], z[2], x[7], x[8],
        x[9], z[3], x[10], x[11], x[12], x[13], x[14], x[15], x[16], x[17],
    )  # fmt: skip


# For compiled code only: to hand a NamedTuple to Python, numba calls Python, and where a signal's handler
# raises in there, the process crashes.
unpacked = compiled(_views)


def packed(state: State) -> Packed:
    """A copy of a state, packed."""
    n = len(state.setpoint)
    made = Packed(np.empty((18, n)), np.empty((n, 10)), np.empty((4, n), dtype=np.int64))
    for own, given in zip(_views(made), state, strict=True):
        own[:] = given
    return made
