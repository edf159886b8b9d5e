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
from ibdata.dynamics.variables import rows
from ibdata.dynamics.variants import Parameters, Variant, resolve
from ibdata.numerics.compiled import compiled

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
    advance(new, a, checked_noise(noise, n), resolve(variant).parameters())
    return new


@compiled
def advance(state: State, action: npt.NDArray[np.floating[Any]], noise: Noise, k: Parameters) -> None:
    """Advance every lane by one step, in place: the compiled part of `step`, without its checks.

    Each equation has a loop of its own, so that the loops without branches are vectorized.
    """
    _steer(state, action, noise, k)
    _update_fatigue(state, noise, k)
    _update_consumption(state, noise, k)


@compiled
def _steer(state: State, action: npt.NDArray[np.floating[Any]], noise: Noise, k: Parameters) -> None:
    """Setpoint, velocity, gain and shift."""
    x = state.floats
    p, v, g, h = x[SETPOINT], x[VELOCITY], x[GAIN], x[SHIFT]
    b, left = x[DRIFT_RATE], state.integers[DRIFT_LEFT]
    for i in range(p.shape[0]):
        if left[i] != NO_DRIFT:
            p[i], b[i], left[i] = drift(
                p[i],
                b[i],
                left[i],
                noise.uniform_drift_length[i],
                noise.uniform_drift_rate[i],
                noise.uniform_drift_zero[i],
                noise.uniform_drift_flip[i],
                k,
            )
    for i in range(p.shape[0]):
        v[i] = steer(v[i], D_V, np.float64(action[i, 0]))
    for i in range(p.shape[0]):
        g[i] = steer(g[i], D_G, np.float64(action[i, 1]))
    for i in range(p.shape[0]):
        h[i] = steer(h[i], D_H, np.float64(action[i, 2]))


@compiled
def _update_fatigue(state: State, noise: Noise, k: Parameters) -> None:
    """Effective velocity and gain, their noise, the hidden μ, and fatigue."""
    x = state.floats
    p, v, g = x[SETPOINT], x[VELOCITY], x[GAIN]
    ve, ge, mu_v, mu_g = x[EFFECTIVE_VELOCITY], x[EFFECTIVE_GAIN], x[MU_V], x[MU_G]
    alpha, f_b, f = x[ALPHA], x[BASIC_FATIGUE], x[FATIGUE]
    eta_v, eta_g = np.empty(p.shape[0]), np.empty(p.shape[0])
    for i in range(p.shape[0]):
        ve[i] = effective_velocity(v[i], g[i], p[i], k.v0, k.g0, k.v1, k.g1)
    for i in range(p.shape[0]):
        ge[i] = effective_gain(g[i], p[i])
    for i in range(p.shape[0]):
        eta_v[i] = noise_component(noise.exp_v[i], noise.uniform_v[i], noise.bernoulli_v[i], ve[i], k)
    for i in range(p.shape[0]):
        eta_g[i] = noise_component(noise.exp_g[i], noise.uniform_g[i], noise.bernoulli_g[i], ge[i], k)
    for i in range(p.shape[0]):
        mu_v[i] = update_mu(mu_v[i], ve[i], eta_v[i])
    for i in range(p.shape[0]):
        mu_g[i] = update_mu(mu_g[i], ge[i], eta_g[i])
    for i in range(p.shape[0]):
        alpha[i] = amplification(
            mu_v[i], mu_g[i], eta_v[i], eta_g[i], noise.normal_alpha[i], k.alpha_threshold
        )
    for i in range(p.shape[0]):
        f_b[i] = basic_fatigue(v[i], g[i])
    for i in range(p.shape[0]):
        f[i] = fatigue(f_b[i], alpha[i])


@compiled
def _update_consumption(state: State, noise: Noise, k: Parameters) -> None:
    """Operational cost, mis-calibration, consumption and reward."""
    x, z = state.floats, state.integers
    p, v, g, h, he = x[SETPOINT], x[VELOCITY], x[GAIN], x[SHIFT], x[EFFECTIVE_SHIFT]
    costs, theta_c = x[COSTS], x[CONVOLVED_COST]
    domain, response, phi, m = z[DOMAIN], z[RESPONSE], z[DIRECTION], x[PENALTY]
    c_hat, c, f, r = x[EXPECTED_CONSUMPTION], x[CONSUMPTION], x[FATIGUE], x[REWARD]
    theta = np.empty(p.shape[0])
    for i in range(p.shape[0]):
        theta[i] = operational_cost(p[i], v[i], g[i])
    remember(theta, costs)
    for i in range(p.shape[0]):
        theta_c[i] = convolved_cost(costs, i, k.weights)
    for i in range(p.shape[0]):
        he[i] = effective_shift(h[i], p[i])
    for i in range(p.shape[0]):
        domain[i], response[i], phi[i] = update_direction(domain[i], response[i], phi[i], he[i])
    for i in range(p.shape[0]):
        m[i] = penalty(phi[i], he[i])
    for i in range(p.shape[0]):
        c_hat[i] = expected_consumption(theta_c[i], m[i], k.consumption_offset)
    for i in range(p.shape[0]):
        c[i] = consumption(c_hat[i], noise.normal_consumption[i], k.consumption_noise)
    for i in range(p.shape[0]):
        r[i] = reward(c[i], f[i])
