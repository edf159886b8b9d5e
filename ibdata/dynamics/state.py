"""What a step takes and gives: the state of any number of lanes, and its noise in standard form.

| symbol | name | unit, range |
|---|---|---|
| p | setpoint | 0 … 100 |
| v, g, h | velocity, gain, shift: the steerings | 0 … 100 |
| c, f, r | consumption, fatigue, reward | cost units; c about -30 … 5800, f in [0, 300] |
| δ, ψ, φ | domain, response, direction of the mis-calibration | ±1, ±1, -6 … 6 |
| μᵛ, μᵍ | latents of the fatigue | 0 … 5 |
| θ, θᶜ, ĉ | operational cost, the convolved one, noise-free consumption | cost units |
| hᵉ, vᵉ, gᵉ | effective shift, velocity, gain | [-1.5, 1.5], [0, 1], [0, 1] |
| m, α, f_b | penalty, amplification, basic fatigue | [-1, 1.24] within 1e-15, [0, 1], [0, 300] |
| b, l | rate and steps left of a moving setpoint's segment | setpoint units per step; steps |
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.dynamics.miscalibration import PHI_MAX
from ibdata.dynamics.setpoint import NO_DRIFT

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class State(NamedTuple):
    """The Markov state of n lanes and the values derived with it; arrays (n,) unless said otherwise."""

    setpoint: Floats
    velocity: Floats
    gain: Floats
    shift: Floats
    consumption: Floats
    fatigue: Floats
    reward: Floats
    operational_cost: Floats  # (n, 10), θ[t-9] … θ[t], oldest first
    domain: Ints
    response: Ints
    direction: Ints
    mu_v: Floats
    mu_g: Floats
    drift_rate: Floats
    drift_left: Ints  # steps left of the segment, counted after the step; -1 = constant setpoint
    convolved_cost: Floats
    penalty: Floats
    expected_consumption: Floats
    effective_shift: Floats
    effective_velocity: Floats
    effective_gain: Floats
    alpha: Floats
    basic_fatigue: Floats


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


INTEGERS = ("domain", "response", "direction", "drift_left")
FINITE = float(np.finfo(np.float64).max)
# Of the fields that the next step reads; the others need only be finite.
STATE_RANGES = {
    **dict.fromkeys(("setpoint", "velocity", "gain", "shift"), (0.0, 100.0)),
    "operational_cost": (0.0, 5000.0),
    "domain": (-1.0, 1.0),
    "response": (-1.0, 1.0),
    "direction": (-float(PHI_MAX), float(PHI_MAX)),
    "mu_v": (0.0, 5.0),
    "mu_g": (0.0, 5.0),
    "drift_rate": (-100.0, 100.0),
    "drift_left": (float(NO_DRIFT), 1e6),
}
# A double's uniforms end below 1; its logarithm, and so Exp(1), at 745; 40 standard deviations are never.
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
    """The state before the zero-action step: `step(state, zeros, noise, variant)` gives the first one.

    Scalars or arrays (n,), all in [0, 100], which are broadcast against each other; domain and response
    are 1, direction and both μ are 0, and the history of operational costs is empty (zeros).

    Raises ValueError naming the argument that is not finite, out of range, or of another shape.
    """
    names = ("setpoint", "velocity", "gain", "shift")
    given = [np.asarray(x, dtype=np.float64) for x in (setpoint, velocity, gain, shift)]
    for name, value in zip(names, given, strict=True):
        if value.ndim > 1:
            raise ValueError(f"initial_state: {name}: found shape {value.shape}, expected a number or (n,)")
        if not np.all((value >= 0.0) & (value <= 100.0)):
            raise ValueError(f"initial_state: {name}: found {value}, expected numbers in [0, 100]")
    try:
        p, v, g, h = (np.array(x) for x in np.broadcast_arrays(*(np.atleast_1d(x) for x in given)))
    except ValueError:
        shapes = ", ".join(f"{name} {value.shape}" for name, value in zip(names, given, strict=True))
        raise ValueError(f"initial_state: found {shapes}, expected equal lengths") from None
    n = p.size
    zeros = State._make(np.zeros(n) for _ in State._fields)
    return zeros._replace(
        setpoint=p,
        velocity=v,
        gain=g,
        shift=h,
        operational_cost=np.zeros((n, 10)),
        domain=np.ones(n, dtype=np.int64),
        response=np.ones(n, dtype=np.int64),
        direction=np.zeros(n, dtype=np.int64),
        drift_left=np.full(n, 0 if drifting else NO_DRIFT, dtype=np.int64),
    )


def checked_state(state: State) -> State:
    """A copy of the state, in which every field has the type, the length and the range of a State."""
    n = len(np.atleast_1d(np.asarray(state.setpoint)))
    fields: dict[str, npt.NDArray[Any]] = {}
    for name, x in zip(State._fields, state, strict=True):
        given = np.asarray(x)
        shape = (n, 10) if name == "operational_cost" else (n,)
        low, high = STATE_RANGES.get(name, (-FINITE, FINITE))
        if given.shape != shape or not np.all((given >= low) & (given <= high)):
            raise ValueError(
                f"step: state.{name}: found {x}, expected {shape} numbers in [{low:g}, {high:g}]"
            )
        fields[name] = np.array(given, dtype=np.int64 if name in INTEGERS else np.float64, order="C")
        if not np.array_equal(fields[name], given):
            raise ValueError(f"step: state.{name}: found {x}, expected whole numbers")
    return State(**fields)


def checked_noise(noise: Noise, n: int) -> Noise:
    """The noise as contiguous float64, every field of length n and in the range of its law."""
    draws = Noise(*(np.array(x, dtype=np.float64, order="C") for x in noise))
    for name, x in zip(Noise._fields, draws, strict=True):
        low, high, law = NOISE_RANGES[name.split("_")[0]]
        if x.shape != (n,) or not np.all((x >= low) & (x <= high)):
            raise ValueError(f"step: noise.{name}: found {x}, expected {n} numbers of {law}")
    return draws
