"""The state of n lanes: the episodes that are simulated side by side."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arrays import Floats
from ibdata.dynamics.consumption import PENALTY_WEIGHT
from ibdata.dynamics.variants import VARIANTS, Variant
from ibdata.views.variables import FIRST_WHOLE, ROWS, VARIABLES, of_role, rows

NO_DRIFT = -1  # the steps left of a constant setpoint
(THETA,) = rows("theta_0")  # the first of the ten rows θ[t], θ[t-1] … θ[t-9]
THETAS = slice(THETA, THETA + 10)
# The attributes of a state; the ten costs are one array.
FIELDS = tuple(dict.fromkeys("operational_cost" if name.startswith("theta_") else name for name in VARIABLES))
SAME_OFFSET = 1e-3  # between consumption offsets, in a state that was rounded to float32
FINITE = float(np.finfo(np.float64).max)
# The next step does not use these, so they need only be finite.
UNREAD = {"fatigue", "consumption", "reward", *of_role("derived")}


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class State:
    """The Markov state of n lanes and the values derived from it: a row of one array for each variable.

    `state.velocity`, and so on for every name in `ibdata.views.variables`, is the row (n,) of a variable,
    int64 for whole numbers; `state.operational_cost` (n, 10) is θ[t-9] … θ[t], oldest first. `replace`
    changes values.
    """

    values: Floats  # (variables, n), in the order of `ROWS`

    @classmethod
    def zeros(cls, n: int) -> State:
        """A state of n lanes in which every variable is 0."""
        return cls(np.zeros((len(ROWS), n)))

    def __repr__(self) -> str:
        return f"<State of {self.lanes} lanes: {', '.join(FIELDS)}>"

    def __getattr__(self, name: str) -> npt.NDArray[Any]:
        if name == "operational_cost":
            return np.moveaxis(self.values[THETAS][::-1], 0, -1)
        if name not in VARIABLES:
            raise AttributeError(f"a State has no variable {name!r}; it has {', '.join(FIELDS)}")
        row: npt.NDArray[Any] = self.values[rows(name)[0]]
        if VARIABLES[name].whole:
            row = row.astype(np.int64)
            row.flags.writeable = False  # a copy, so writing to it would change nothing
        return row

    @property
    def lanes(self) -> int:
        """The number of lanes, n."""
        n: int = self.values.shape[1]
        return n

    def take(self, lanes: npt.NDArray[np.int64]) -> State:
        """A copy of some lanes."""
        return State(self.values.take(lanes, axis=1))

    def put(self, lanes: npt.NDArray[np.int64], part: State) -> None:
        """Write the state of some lanes."""
        self.values[:, lanes] = part.values

    def replace(self, **values: npt.ArrayLike) -> State:
        """A copy in which some variables have other values.

        Args:
            **values: new values by the name of the variable, each of the shape of that attribute.

        Returns:
            A state that shares no memory with this one.

        Raises:
            ValueError: an array has the wrong shape, or a variable of whole numbers is given a fraction.
        """
        new = State(self.values.copy())
        for name, value in values.items():
            old, array = getattr(new, name), np.asarray(value)
            if array.shape != old.shape:
                raise ValueError(f"state.{name}: found shape {array.shape}, expected {old.shape}")
            if name == "operational_cost":
                old[...] = array
                continue
            if VARIABLES[name].whole and not np.array_equal(array, np.trunc(array)):
                raise ValueError(f"state.{name}: found {array}, expected whole numbers")
            new.values[rows(name)[0]] = array
        return new


def initial_state(
    setpoint: npt.ArrayLike,
    velocity: npt.ArrayLike = 50.0,
    gain: npt.ArrayLike = 50.0,
    shift: npt.ArrayLike = 50.0,
    drifting: bool = False,
) -> State:
    """The state before the first step of an episode, whose action is zero.

    `step(state, zeros, noise, variant)` gives the state of the first observation. The four numbers or arrays
    (n,) are broadcast against each other.

    Args:
        setpoint: in [0, 100].
        velocity: in [0, 100].
        gain: in [0, 100].
        shift: in [0, 100].
        drifting: whether the setpoint moves.

    Returns:
        A state in which domain and response are 1, direction and both μ are 0, and the history of operational
        costs is empty (zeros).

    Raises:
        ValueError: an argument is not finite, out of range, or of the wrong shape; the message names it.
    """
    names = ("setpoint", "velocity", "gain", "shift")
    values = [np.asarray(x, dtype=np.float64) for x in (setpoint, velocity, gain, shift)]
    for name, value in zip(names, values, strict=True):
        if value.ndim > 1:
            raise ValueError(f"initial_state: {name}: found shape {value.shape}, expected a number or (n,)")
        if not np.all((value >= 0.0) & (value <= 100.0)):
            raise ValueError(f"initial_state: {name}: found {value}, expected numbers in [0, 100]")
    try:
        steerings = np.broadcast_arrays(*map(np.atleast_1d, values))
    except ValueError:
        shapes = ", ".join(f"{name} {value.shape}" for name, value in zip(names, values, strict=True))
        raise ValueError(f"initial_state: found {shapes}, expected equal lengths") from None
    state = State.zeros(steerings[0].size)
    state.values[list(rows(*names))] = steerings
    state.values[list(rows("domain", "response"))] = 1.0
    state.values[rows("drift_left")[0]] = 0.0 if drifting else NO_DRIFT
    return state


def checked_state(state: State, variant: Variant) -> State:
    """A copy of the state, which a variant is to play.

    Raises ValueError if a variable is out of its range or no whole number, or if ĉ = θᶜ + 25 (m + offset)
    holds for another published variant.
    """
    values = np.array(state.values, dtype=np.float64, order="C")
    if values.ndim != 2 or len(values) != len(ROWS):
        raise ValueError(f"step: state: found shape {values.shape}, expected ({len(ROWS)}, lanes)")
    inside = ((values >= LOW) & (values <= HIGH)).all(axis=1)
    whole = (values[FIRST_WHOLE:] == np.trunc(values[FIRST_WHOLE:])).all(axis=1)
    if not inside.all():
        row = int(np.argmin(inside))
        name = "operational_cost" if ROWS[row].startswith("theta_") else ROWS[row]
        expected = f"numbers in [{LOW[row, 0]:g}, {HIGH[row, 0]:g}]"
        raise ValueError(f"step: state.{name}: found {values[row]}, expected {expected}")
    if not whole.all():
        row = FIRST_WHOLE + int(np.argmin(whole))
        raise ValueError(f"step: state.{ROWS[row]}: found {values[row]}, expected whole numbers")
    checked = State(values)
    c_hat = checked.expected_consumption  # 0 before the first step, and where somebody made the state
    offset = (c_hat - checked.convolved_cost) / PENALTY_WEIGHT - checked.penalty
    for dynamics, other in VARIANTS.items():
        is_other = (np.abs(offset - other.consumption_offset) < SAME_OFFSET) & (c_hat != 0.0)
        if is_other.any() and variant.consumption_offset != other.consumption_offset:
            raise ValueError(
                f"step: found a state of the dynamics {dynamics}, expected one of those that play it; "
                f'choose "{dynamics}", for rollouts ("{dynamics}", state)'
            )
    return checked


def _bounds(variable: str) -> tuple[float, float]:
    """The lowest and the highest value of a variable that `step` accepts."""
    low, high = VARIABLES[variable].low, VARIABLES[variable].high
    if variable in UNREAD:
        low = high = None
    return -FINITE if low is None else low, FINITE if high is None else high


LOW, HIGH = np.array([_bounds(name) for name in ROWS]).T[:, :, None]
