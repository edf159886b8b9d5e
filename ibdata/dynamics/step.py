"""One step of the benchmark for any number of lanes: state, action and noise in, state out."""

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
from ibdata.dynamics.state import Noise, State, checked_noise, checked_state
from ibdata.dynamics.steering import D_G, D_H, D_V, steer
from ibdata.dynamics.variants import Parameters, Variant, resolve
from ibdata.numerics.compiled import compiled


def step(state: State, action: npt.ArrayLike, noise: Noise, variant: Variant | str = "siemens") -> State:
    """The state one step later; nothing given is changed.

    action (n, 3) holds (Δv, Δg, Δh), clipped to [-1, 1]; noise is in standard form; the variant is a
    `Variant` or the name of one. The order of the parts is that of the authors' `IDS.step`: setpoint,
    steering, fatigue, operational cost, mis-calibration, consumption, reward (the paper names none).

    Raises ValueError for a state, action or noise that is not finite, of another length, or out of range.
    """
    new = checked_state(state)
    n = new.setpoint.shape[0]
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
    """One step of every lane, in place: the compiled part of `step`, without its checks.

    A loop for each equation: those that do not branch then work on several lanes at a time.
    """
    _steer(state, action, noise, k)
    _update_fatigue(state, noise, k)
    _update_consumption(state, noise, k)


@compiled
def _steer(state: State, action: npt.NDArray[np.floating[Any]], noise: Noise, k: Parameters) -> None:
    """Setpoint, velocity, gain and shift."""
    p, v, g, h = state.setpoint, state.velocity, state.gain, state.shift
    for i in range(p.shape[0]):
        if state.drift_left[i] != NO_DRIFT:
            p[i], state.drift_rate[i], state.drift_left[i] = drift(
                p[i],
                state.drift_rate[i],
                state.drift_left[i],
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
    p, v, g = state.setpoint, state.velocity, state.gain
    ve, ge, mu_v, mu_g = state.effective_velocity, state.effective_gain, state.mu_v, state.mu_g
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
        state.alpha[i] = amplification(
            mu_v[i], mu_g[i], eta_v[i], eta_g[i], noise.normal_alpha[i], k.alpha_threshold
        )
    for i in range(p.shape[0]):
        state.basic_fatigue[i] = basic_fatigue(v[i], g[i])
    for i in range(p.shape[0]):
        state.fatigue[i] = fatigue(state.basic_fatigue[i], state.alpha[i])


@compiled
def _update_consumption(state: State, noise: Noise, k: Parameters) -> None:
    """Operational cost, mis-calibration, consumption and reward."""
    p, v, g, h, he = state.setpoint, state.velocity, state.gain, state.shift, state.effective_shift
    theta = np.empty(p.shape[0])
    for i in range(p.shape[0]):
        theta[i] = operational_cost(p[i], v[i], g[i])
    for i in range(p.shape[0]):
        remember(theta[i], state.operational_cost, i)
        state.convolved_cost[i] = convolved_cost(state.operational_cost, i, k.weights)
    for i in range(p.shape[0]):
        he[i] = effective_shift(h[i], p[i])
    for i in range(p.shape[0]):
        state.domain[i], state.response[i], state.direction[i] = update_direction(
            state.domain[i], state.response[i], state.direction[i], he[i]
        )
    for i in range(p.shape[0]):
        state.penalty[i] = penalty(state.direction[i], he[i])
    for i in range(p.shape[0]):
        state.expected_consumption[i] = expected_consumption(
            state.convolved_cost[i], state.penalty[i], k.consumption_offset
        )
    for i in range(p.shape[0]):
        state.consumption[i] = consumption(
            state.expected_consumption[i], noise.normal_consumption[i], k.consumption_noise
        )
    for i in range(p.shape[0]):
        state.reward[i] = reward(state.consumption[i], state.fatigue[i])
