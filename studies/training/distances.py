"""How far the dynamics at two setpoints are apart: the distance between the distributions of what follows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata._numerics.exact import exponential, normal
from ibdata.dynamics import Noise, State, initial_state, step

STATES, DRAWS, SEED = 2000, 64, 0
LONGEST = 200
HORIZONS = (1, 10)  # after 10 steps, θ has passed the convolution, and a setpoint has its full effect
QUANTITIES = ("fatigue", "consumption")
Array = npt.NDArray[np.float64]


def noise(rng: np.random.Generator, n: int) -> Noise:
    """Standard noise for n lanes at a constant setpoint, made from uniforms by ibdata's own transforms."""
    u = {name: rng.uniform(2.0**-53, 1.0, n) for name in Noise._fields}
    for name, x in u.items():
        if name.startswith(("exp", "normal")):
            transform = exponential if name.startswith("exp") else normal
            u[name] = np.array([transform(y) for y in x.tolist()])
    return Noise(**u)


def states(rng: np.random.Generator, n: int, dynamics: str, source: float) -> State:
    """States that random episodes at the source setpoint pass through."""
    state = step(initial_state(np.full(n, source)), np.zeros((n, 3)), noise(rng, n), dynamics)
    stop = rng.integers(20, LONGEST, n)
    for t in range(LONGEST):
        moved = step(state, rng.uniform(-1.0, 1.0, (n, 3)), noise(rng, n), dynamics)
        going = t < stop
        state = State(np.where(going, moved.values, state.values))
    return state


def measure(
    dynamics: str,
    source: float,
    setpoints: Sequence[float],
    n: int = STATES,
    draws: int = DRAWS,
    seed: int = SEED,
) -> dict[tuple[int, str], Array]:
    """Wasserstein distances (setpoints, states) from a source by horizon and quantity."""
    rng = np.random.default_rng([seed, len(dynamics)])
    start = State(np.repeat(states(rng, n, dynamics, source).values, draws, axis=-1))
    last = max(HORIZONS)
    actions = [np.repeat(rng.uniform(-1.0, 1.0, (n, 3)), draws, axis=0) for _ in range(last)]
    noises = [noise(rng, n * draws) for _ in range(last)]
    values: dict[tuple[int, str], Any] = {(h, name): [] for h in HORIZONS for name in QUANTITIES}
    for p in (source, *setpoints):
        state = start.replace(setpoint=np.full(n * draws, p))
        for t in range(last):
            state = step(state, actions[t], noises[t], dynamics)
            for name in QUANTITIES if t + 1 in HORIZONS else ():
                values[t + 1, name].append(np.sort(getattr(state, name).reshape(n, draws), axis=1))
    return {key: np.abs(np.array(x[1:]) - x[0]).mean(axis=2) for key, x in values.items()}
