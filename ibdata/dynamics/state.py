"""The state of any number of lanes, and the noise of one step in standard form.

A lane is one of the episodes that are simulated side by side. `variables.py` lists the variables.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.dynamics.setpoint import NO_DRIFT
from ibdata.variables import FLOATS, INTEGERS, VARIABLES, of_role, rows

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

(THETA,) = rows("theta_0")  # the first of the ten rows θ[t], θ[t-1] … θ[t-9]
COSTS = slice(THETA, THETA + 10)
# The attributes of a state; the ten costs are one array.
FIELDS = tuple(dict.fromkeys("operational_cost" if name.startswith("theta_") else name for name in VARIABLES))
FINITE = float(np.finfo(np.float64).max)
# The next step does not use these, so they need only be finite.
UNREAD = {"fatigue", "consumption", "reward", *of_role("derived")}


class State(NamedTuple):
    """The Markov state of n lanes and the values derived from it.

    `state.velocity`, and so on for every name in `ibdata.variables`, is a view (n,) of a row;
    `state.operational_cost` (n, 10) is θ[t-9] … θ[t], oldest first. Writing to a view changes the state.
    """

    floats: Floats  # (float variables, n)
    integers: Ints  # (whole variables, n)

    def __getattr__(self, name: str) -> npt.NDArray[Any]:
        if name == "operational_cost":
            return np.moveaxis(self.floats[COSTS][::-1], 0, -1)
        if name not in VARIABLES:
            raise AttributeError(f"a State has no variable {name!r}; it has {', '.join(FIELDS)}")
        part: npt.NDArray[Any] = self.integers if VARIABLES[name].whole else self.floats
        view: npt.NDArray[Any] = part[rows(name)[0]]
        return view

    def replace(self, **values: npt.ArrayLike) -> State:
        """A copy in which some variables have other values.

        Args:
            **values: new values by the name of the variable, each of the shape of that attribute.

        Returns:
            A state that shares no memory with this one.

        Raises:
            ValueError: an array has the wrong shape, or a variable of whole numbers is given a fraction.
        """
        new = State(self.floats.copy(), self.integers.copy())
        for name, x in values.items():
            view, given = getattr(new, name), np.asarray(x)
            if given.shape != view.shape:
                raise ValueError(f"state.{name}: found shape {given.shape}, expected {view.shape}")
            with np.errstate(invalid="ignore"):  # NaN cannot become a whole number
                view[...] = given
            if view.dtype == np.int64 and not np.array_equal(view, given):
                raise ValueError(f"state.{name}: found {given}, expected whole numbers")
        return new


class Noise(NamedTuple):
    """The random numbers of one step of n lanes in standard form; arrays (n,)."""

    exp_v: Floats  # Exp(1)
    exp_g: Floats
    bernoulli_v: Floats  # U(0, 1); the event is u < p
    bernoulli_g: Floats
    uniform_v: Floats  # U(0, 1)
    uniform_g: Floats
    normal_alpha: Floats  # N(0, 1)
    normal_consumption: Floats
    uniform_drift_length: Floats  # U(0, 1); used by moving setpoints only
    uniform_drift_rate: Floats
    uniform_drift_zero: Floats
    uniform_drift_flip: Floats


# A uniform draw is below 1, and -log of the least double is below 745.2; no normal draw exceeds 40.
NOISE_RANGES = {
    "exp": (0.0, 745.2, "Exp(1)"),
    "bernoulli": (0.0, 1.0 - 2.0**-53, "U(0, 1)"),
    "uniform": (0.0, 1.0 - 2.0**-53, "U(0, 1)"),
    "normal": (-40.0, 40.0, "N(0, 1)"),
}


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
    given = [np.asarray(x, dtype=np.float64) for x in (setpoint, velocity, gain, shift)]
    for name, value in zip(names, given, strict=True):
        if value.ndim > 1:
            raise ValueError(f"initial_state: {name}: found shape {value.shape}, expected a number or (n,)")
        if not np.all((value >= 0.0) & (value <= 100.0)):
            raise ValueError(f"initial_state: {name}: found {value}, expected numbers in [0, 100]")
    try:
        steerings = np.broadcast_arrays(*(np.atleast_1d(x) for x in given))
    except ValueError:
        shapes = ", ".join(f"{name} {value.shape}" for name, value in zip(names, given, strict=True))
        raise ValueError(f"initial_state: found {shapes}, expected equal lengths") from None
    n = steerings[0].size
    state = State(np.zeros((len(FLOATS), n)), np.zeros((len(INTEGERS), n), dtype=np.int64))
    for name, value in zip(names, steerings, strict=True):
        getattr(state, name)[:] = value
    state.domain[:] = state.response[:] = 1
    state.drift_left[:] = 0 if drifting else NO_DRIFT
    return state


def checked_state(state: State) -> State:
    """A copy of the state. Raises ValueError if a variable is out of its range."""
    new = State(
        np.array(state.floats, dtype=np.float64, order="C"),
        np.array(state.integers, dtype=np.int64, order="C"),
    )
    n = new.floats.shape[-1]
    found, expected = (new.floats.shape, new.integers.shape), ((len(FLOATS), n), (len(INTEGERS), n))
    if found != expected or not np.array_equal(new.integers, state.integers):
        raise ValueError(
            f"step: state: found shapes {found}, expected {expected}, of floats and of whole numbers"
        )
    for part, (low, high) in zip(new, (FLOAT_RANGES, INTEGER_RANGES), strict=True):
        outside = ~((part >= low) & (part <= high)).all(axis=1)
        if outside.any():
            i = int(np.argmax(outside))
            name = (FLOATS if part is new.floats else INTEGERS)[i]
            field = "operational_cost" if name.startswith("theta_") else name
            x = getattr(new, field)
            raise ValueError(
                f"step: state.{field}: found {x}, expected numbers in [{low[i, 0]:g}, {high[i, 0]:g}]"
            )
    return new


def _ranges(names: tuple[str, ...]) -> tuple[Floats, Floats]:
    """The lowest and the highest values (variables, 1) that `step` accepts."""
    known = [(None, None) if name in UNREAD else VARIABLES[name][3:5] for name in names]
    low = [-FINITE if low is None else low for low, _ in known]
    high = [FINITE if high is None else high for _, high in known]
    return np.array([low]).T, np.array([high]).T


FLOAT_RANGES, INTEGER_RANGES = _ranges(FLOATS), _ranges(INTEGERS)


def checked_noise(noise: Noise, n: int) -> Noise:
    """The noise as contiguous float64. Raises ValueError if a field is not n numbers of its law."""
    draws = Noise(*(np.array(x, dtype=np.float64, order="C") for x in noise))
    for name, x in zip(Noise._fields, draws, strict=True):
        low, high, law = NOISE_RANGES[name.split("_")[0]]
        if x.shape != (n,) or not np.all((x >= low) & (x <= high)):
            raise ValueError(f"step: noise.{name}: found {x}, expected {n} numbers of {law}")
    return draws
