"""One step of the benchmark for any number of lanes."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.dynamics.consumption import consumption, expected_consumption, reward
from ibdata.dynamics.fatigue import (
    amplification,
    basic_fatigue,
    effective_gain,
    effective_velocity,
    fatigue,
    noise_component,
    update_mu,
)
from ibdata.dynamics.miscalibration import effective_shift, penalty, update_direction
from ibdata.dynamics.operational_cost import convolved_cost, operational_cost, remember
from ibdata.dynamics.setpoint import NO_DRIFT, drift
from ibdata.dynamics.state import COSTS, Noise, State, checked_noise, checked_state
from ibdata.dynamics.steering import D_G, D_H, D_V, steer
from ibdata.dynamics.variants import Parameters, Variant, resolve
from ibdata.numerics.compiled import inlined
from ibdata.variables import rows

SETPOINT, VELOCITY, GAIN, SHIFT = rows("setpoint", "velocity", "gain", "shift")
CONSUMPTION, FATIGUE, REWARD = rows("consumption", "fatigue", "reward")
DOMAIN, RESPONSE, DIRECTION = rows("domain", "response", "direction")
MU_V, MU_G, DRIFT_RATE, DRIFT_LEFT = rows("mu_v", "mu_g", "drift_rate", "drift_left")
EFFECTIVE_VELOCITY, EFFECTIVE_GAIN, EFFECTIVE_SHIFT = rows(
    "effective_velocity", "effective_gain", "effective_shift"
)
CONVOLVED_COST, PENALTY, EXPECTED_CONSUMPTION = rows("convolved_cost", "penalty", "expected_consumption")
ALPHA, BASIC_FATIGUE = rows("alpha", "basic_fatigue")


def step(state: State, action: npt.ArrayLike, noise: Noise, variant: Variant | str = "siemens") -> State:
    """The state one step later. The arguments are not changed.

    The parts are computed in the order of the authors' `IDS.step`, because the paper gives none: setpoint,
    steering, fatigue, operational cost, mis-calibration, consumption, reward.

    Args:
        state: n lanes.
        action: (n, 3) = (Δv, Δg, Δh), clipped to [-1, 1].
        noise: the random numbers of the step, in standard form.
        variant: the dynamics, as a `Variant` or by the name of a published one.

    Returns:
        A state that shares no memory with the one given.

    Raises:
        ValueError: state, action or noise is not finite, out of range, or of the wrong length.
    """
    new = checked_state(state)
    n = new.floats.shape[1]
    a = np.array(action, dtype=np.float64)
    if a.shape != (n, 3):
        raise ValueError(f"step: action: found shape {a.shape}, expected ({n}, 3)")
    if not np.isfinite(a).all():
        lane = int(np.argmin(np.isfinite(a).all(axis=1)))
        raise ValueError(f"step: action: found {a[lane]} in lane {lane}, expected finite numbers")
    advance(new, a, checked_noise(noise, n), resolve(variant).parameters)
    return new


@inlined
def advance(state: State, action: npt.NDArray[np.floating[Any]], noise: Noise, k: Parameters) -> None:
    """Advance every lane by one step, in place: the compiled part of `step`, without its checks.

    Each equation has a loop of its own, so that the loops without branches are vectorized. They name the
    rows of the state by number: numba counts references to views of rows, which takes as long as the
    equations of one lane. The noise is overwritten.
    """
    _steer(state, action, noise, k)
    _update_fatigue(state, noise, k)
    _update_consumption(state, noise, k)


@inlined
def _steer(state: State, action: npt.NDArray[np.floating[Any]], noise: Noise, k: Parameters) -> None:
    """Setpoint, velocity, gain and shift."""
    x, z = state.floats, state.integers
    for i in range(x.shape[1]):
        if z[DRIFT_LEFT, i] != NO_DRIFT:
            x[SETPOINT, i], x[DRIFT_RATE, i], z[DRIFT_LEFT, i] = drift(
                x[SETPOINT, i],
                x[DRIFT_RATE, i],
                z[DRIFT_LEFT, i],
                noise.uniform_drift_length[i],
                noise.uniform_drift_rate[i],
                noise.uniform_drift_zero[i],
                noise.uniform_drift_flip[i],
                k,
            )
    for i in range(x.shape[1]):
        x[VELOCITY, i] = steer(x[VELOCITY, i], D_V, np.float64(action[i, 0]))
    for i in range(x.shape[1]):
        x[GAIN, i] = steer(x[GAIN, i], D_G, np.float64(action[i, 1]))
    for i in range(x.shape[1]):
        x[SHIFT, i] = steer(x[SHIFT, i], D_H, np.float64(action[i, 2]))


@inlined
def _update_fatigue(state: State, noise: Noise, k: Parameters) -> None:
    """Effective velocity and gain, their noise, the hidden μ, and fatigue."""
    x = state.floats
    eta_v, eta_g = noise.exp_v, noise.exp_g  # each η takes the place of a draw
    for i in range(x.shape[1]):
        x[EFFECTIVE_VELOCITY, i] = effective_velocity(
            x[VELOCITY, i], x[GAIN, i], x[SETPOINT, i], k.v0, k.g0, k.v1, k.g1
        )
    for i in range(x.shape[1]):
        x[EFFECTIVE_GAIN, i] = effective_gain(x[GAIN, i], x[SETPOINT, i])
    for i in range(x.shape[1]):
        eta_v[i] = noise_component(
            noise.exp_v[i], noise.uniform_v[i], noise.bernoulli_v[i], x[EFFECTIVE_VELOCITY, i], k
        )
    for i in range(x.shape[1]):
        eta_g[i] = noise_component(
            noise.exp_g[i], noise.uniform_g[i], noise.bernoulli_g[i], x[EFFECTIVE_GAIN, i], k
        )
    for i in range(x.shape[1]):
        x[MU_V, i] = update_mu(x[MU_V, i], x[EFFECTIVE_VELOCITY, i], eta_v[i])
    for i in range(x.shape[1]):
        x[MU_G, i] = update_mu(x[MU_G, i], x[EFFECTIVE_GAIN, i], eta_g[i])
    for i in range(x.shape[1]):
        x[ALPHA, i] = amplification(
            x[MU_V, i], x[MU_G, i], eta_v[i], eta_g[i], noise.normal_alpha[i], k.alpha_threshold
        )
    for i in range(x.shape[1]):
        x[BASIC_FATIGUE, i] = basic_fatigue(x[VELOCITY, i], x[GAIN, i])
    for i in range(x.shape[1]):
        x[FATIGUE, i] = fatigue(x[BASIC_FATIGUE, i], x[ALPHA, i])


@inlined
def _update_consumption(state: State, noise: Noise, k: Parameters) -> None:
    """Operational cost, mis-calibration, consumption and reward."""
    x, z = state.floats, state.integers
    costs, theta = x[COSTS], x[CONVOLVED_COST]  # θ is in the place of θᶜ until that is known
    for i in range(x.shape[1]):
        theta[i] = operational_cost(x[SETPOINT, i], x[VELOCITY, i], x[GAIN, i])
    remember(theta, costs)
    for i in range(x.shape[1]):
        x[CONVOLVED_COST, i] = convolved_cost(costs, i, k.weights)
    for i in range(x.shape[1]):
        x[EFFECTIVE_SHIFT, i] = effective_shift(x[SHIFT, i], x[SETPOINT, i])
    for i in range(x.shape[1]):
        z[DOMAIN, i], z[RESPONSE, i], z[DIRECTION, i] = update_direction(
            z[DOMAIN, i], z[RESPONSE, i], z[DIRECTION, i], x[EFFECTIVE_SHIFT, i]
        )
    for i in range(x.shape[1]):
        x[PENALTY, i] = penalty(z[DIRECTION, i], x[EFFECTIVE_SHIFT, i])
    for i in range(x.shape[1]):
        x[EXPECTED_CONSUMPTION, i] = expected_consumption(
            x[CONVOLVED_COST, i], x[PENALTY, i], k.consumption_offset
        )
    for i in range(x.shape[1]):
        x[CONSUMPTION, i] = consumption(
            x[EXPECTED_CONSUMPTION, i], noise.normal_consumption[i], k.consumption_noise
        )
    for i in range(x.shape[1]):
        x[REWARD, i] = reward(x[CONSUMPTION, i], x[FATIGUE, i])
