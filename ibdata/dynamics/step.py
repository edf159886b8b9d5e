"""One step of the benchmark for any number of lanes: state, action and noise in, state out."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.compiling import compiled
from ibdata.dynamics.consumption import consumption, expected_consumption, reward
from ibdata.dynamics.fatigue import (
    amplification,
    basic_fatigue,
    effective_gain,
    effective_velocity,
    fatigue,
    hidden,
    noise_component,
)
from ibdata.dynamics.miscalibration import effective_shift, penalty, turn
from ibdata.dynamics.operational_cost import convolved_cost, operational_cost, remember
from ibdata.dynamics.setpoint import NO_DRIFT, drift
from ibdata.dynamics.state import Noise, State, checked_noise, checked_state
from ibdata.dynamics.steering import D_G, D_H, D_V, steer
from ibdata.dynamics.variants import Parameters, Variant, resolve


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
    """One step of every lane, in place: the compiled part of `step`, without its checks."""
    for i in range(state.setpoint.shape[0]):
        p = state.setpoint[i]
        if state.drift_left[i] != NO_DRIFT:
            p, state.drift_rate[i], state.drift_left[i] = drift(
                p,
                state.drift_rate[i],
                state.drift_left[i],
                noise.uniform_drift_length[i],
                noise.uniform_drift_rate[i],
                noise.uniform_drift_zero[i],
                noise.uniform_drift_flip[i],
                k,
            )
            state.setpoint[i] = p

        v = steer(state.velocity[i], D_V, np.float64(action[i, 0]))
        g = steer(state.gain[i], D_G, np.float64(action[i, 1]))
        h = steer(state.shift[i], D_H, np.float64(action[i, 2]))
        state.velocity[i], state.gain[i], state.shift[i] = v, g, h

        ve = effective_velocity(v, g, p, k.v0, k.g0, k.v1, k.g1)
        ge = effective_gain(g, p)
        eta_v = noise_component(noise.exp_v[i], noise.uniform_v[i], noise.bernoulli_v[i], ve, k)
        eta_g = noise_component(noise.exp_g[i], noise.uniform_g[i], noise.bernoulli_g[i], ge, k)
        mu_v = hidden(state.mu_v[i], ve, eta_v)
        mu_g = hidden(state.mu_g[i], ge, eta_g)
        alpha = amplification(mu_v, mu_g, eta_v, eta_g, noise.normal_alpha[i], k.alpha_threshold)
        f_b = basic_fatigue(v, g)
        f = fatigue(f_b, alpha)
        state.effective_velocity[i], state.effective_gain[i] = ve, ge
        state.mu_v[i], state.mu_g[i], state.alpha[i] = mu_v, mu_g, alpha
        state.basic_fatigue[i], state.fatigue[i] = f_b, f

        remember(operational_cost(p, v, g), state.operational_cost, i)
        theta_c = convolved_cost(state.operational_cost, i, k.weights)
        state.convolved_cost[i] = theta_c

        he = effective_shift(h, p)
        delta, psi, phi = turn(state.domain[i], state.response[i], state.direction[i], he)
        m = penalty(phi, he)
        state.effective_shift[i], state.penalty[i] = he, m
        state.domain[i], state.response[i], state.direction[i] = delta, psi, phi

        c_hat = expected_consumption(theta_c, m, k.consumption_offset)
        c = consumption(c_hat, noise.normal_consumption[i], k.consumption_noise)
        state.expected_consumption[i], state.consumption[i] = c_hat, c
        state.reward[i] = reward(c, f)
