"""The check of a state from which an environment is to go on."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.dynamics import State
from ibdata.dynamics.state import checked_state
from ibdata.errors import UsageError, excerpt
from ibdata.numerics.naming import counted

Indices = npt.NDArray[np.int64]


def fitting_state(given: Any, lanes: int, drifting: bool) -> State:
    """Return a state of so many lanes, whose setpoints move or do not; UsageError if it is no such state."""
    if not isinstance(given, State):
        raise UsageError(f"set_state: found {type(given).__name__}, expected a State as of ibdata.state_at")
    try:
        state = checked_state(given)
    except ValueError as error:
        raise UsageError(f"set_state: {str(error).removeprefix('step: ')}") from None
    moves = state.drift_left >= 0
    if len(moves) != lanes:
        expected = "one lane" if lanes == 1 else f"{lanes} lanes"
        found = counted(len(moves), "lane")
        raise UsageError(f"set_state: found a state of {found}, expected a state of {expected}")
    if (moves != drifting).any():
        found, option = ("a constant", "a number") if drifting else ("a moving", '"drifting"')
        raise UsageError(
            f"set_state: found a state of {found} setpoint; make the environment with setpoint={option}"
        )
    return state


def checked_lanes(given: Any, count: int) -> Indices:
    """Return different lanes (k,) of so many; UsageError if they are no such lanes."""
    lanes = np.atleast_1d(np.asarray(given))
    whole = lanes.dtype.kind in "iu" and lanes.ndim == 1 and lanes.size > 0
    if not whole or not np.isin(lanes, np.arange(count)).all() or len(np.unique(lanes)) < len(lanes):
        found = excerpt(given)
        raise UsageError(f"lanes: found {found}, expected different whole numbers from 0 to {count - 1}")
    return lanes.astype(np.int64)
