"""Tapes: the actions and the noise of a whole run, drawn from one seed, and functions that play them."""

from __future__ import annotations

import hashlib
from typing import NamedTuple

import numpy as np

from ibdata.dynamics import Noise, State, Variant, initial_state, step
from ibdata.dynamics.state import FIELDS

RARE = 0.15  # the share of uniform draws that are replaced by values near the ends of (0, 1)


class Tape(NamedTuple):
    """Actions (steps, n, 3), the first all zero, and noise whose arrays are (steps, n)."""

    actions: np.ndarray
    noise: Noise


def uniform(rng: np.random.Generator, *shape: int) -> np.ndarray:
    """Draws from the open interval (0, 1), of which more than usual are near its ends."""
    u = (rng.integers(0, 2**52, shape) + 0.5) * 2.0**-52
    ends = np.array([2.0**-53, 0.0005, 0.9995, 1.0 - 2.0**-53])
    return np.where(rng.random(shape) < RARE, rng.choice(ends, shape), u)


def noise(rng: np.random.Generator, *shape: int) -> Noise:
    """Noise in standard form with arrays of this shape: (n,) for a step, (steps, n) for a tape."""
    draws = {name: uniform(rng, *shape) for name in Noise._fields}
    for name in ("exp_v", "exp_g"):
        draws[name] = rng.standard_exponential(shape)
    for name in ("normal_alpha", "normal_consumption"):
        draws[name] = rng.standard_normal(shape)
    return Noise(**draws)


def draw(seed: int, steps: int, n: int) -> Tape:
    """A tape whose actions have another trend in each lane, towards the bounds; some exceed 1."""
    rng = np.random.default_rng(seed)
    trend = rng.uniform(-0.6, 0.6, (1, n, 3))
    actions = trend + rng.uniform(-1.5, 1.5, (steps, n, 3))
    actions[0] = 0.0
    return Tape(actions, noise(rng, steps, n))


def start(n: int, drifting: str = "none") -> State:
    """A state with setpoints from 0 to 100 over the lanes; velocity and gain are in the middle or at bounds.

    The setpoint moves in no lane ("none"), in all ("all"), or in every other one ("half").
    """
    velocity, gain = np.resize([50.0, 0.0, 100.0], n), np.resize([50.0, 100.0, 0.0], n)
    state = initial_state(np.linspace(0.0, 100.0, n), velocity, gain, drifting=drifting != "none")
    if drifting == "half":
        left = state.drift_left.copy()
        left[1::2] = -1
        state = state.replace(drift_left=left)
    return state


def at(fields: Noise, t: int) -> Noise:
    """The noise of one step of a tape."""
    return Noise(*(x[t] for x in fields))


def play(state: State, tape: Tape, variant: Variant | str) -> list[State]:
    """The states after each step of the tape."""
    states = []
    for t, action in enumerate(tape.actions):
        state = step(state, action, at(tape.noise, t), variant)
        states.append(state)
    return states


def stack(states: list[State]) -> State:
    """Many states as one, with the time as the first axis of each field."""
    return State(np.stack([state.values for state in states], axis=1))


def take(state: State, lanes: object) -> State:
    """Some lanes of a state, or some times and lanes of a stack, by an index as for an array."""
    index = lanes if isinstance(lanes, tuple) else (lanes,)
    return State(state.values[(slice(None), *index)])


def changed(a: State, b: State) -> set[str]:
    """The names of the fields that differ in any bit between two states, or two stacks of states."""
    pairs = ((name, getattr(a, name), getattr(b, name)) for name in FIELDS)
    return {
        name for name, x, y in pairs if (x.dtype, x.shape, x.tobytes()) != (y.dtype, y.shape, y.tobytes())
    }


def digest() -> str:
    """SHA-256 of 40 steps of 5 lanes in both variants, with every other setpoint moving."""
    sha = hashlib.sha256()
    for variant in ("siemens", "paper"):
        states = stack(play(start(5, "half"), draw(40, 40, 5), variant))
        for name in FIELDS:
            sha.update(getattr(states, name).tobytes())
    return sha.hexdigest()
