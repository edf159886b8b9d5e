"""The noise of a step of the dynamics, from random integers."""

from __future__ import annotations

import numpy as np

from ibdata.dynamics.state import Noise
from ibdata.numerics.compiled import compiled, inlined
from ibdata.numerics.exact import exponential, normals
from ibdata.numerics.philox import Raw
from ibdata.numerics.random import uniform

DYNAMICS_SLOTS = 8
DRIFT_SLOTS = 4


@compiled
def standard_noise(raw: Raw, noise: Noise) -> None:
    """Fill the fields that every step uses, in their order, from integers (8, n)."""
    for i in range(raw.shape[1]):
        noise.exp_v[i] = exponential(uniform(raw[0, i]))
    for i in range(raw.shape[1]):
        noise.exp_g[i] = exponential(uniform(raw[1, i]))
    for i in range(raw.shape[1]):
        noise.bernoulli_v[i] = uniform(raw[2, i])
        noise.bernoulli_g[i] = uniform(raw[3, i])
        noise.uniform_v[i] = uniform(raw[4, i])
        noise.uniform_g[i] = uniform(raw[5, i])
        noise.normal_alpha[i] = uniform(raw[6, i])
        noise.normal_consumption[i] = uniform(raw[7, i])
    normals(noise.normal_alpha)
    normals(noise.normal_consumption)


@compiled
def drift_noise(raw: Raw, noise: Noise) -> None:
    """Fill the fields that a moving setpoint uses, in their order, from integers (4, n)."""
    for i in range(raw.shape[1]):
        noise.uniform_drift_length[i] = uniform(raw[0, i])
        noise.uniform_drift_rate[i] = uniform(raw[1, i])
        noise.uniform_drift_zero[i] = uniform(raw[2, i])
        noise.uniform_drift_flip[i] = uniform(raw[3, i])


def blank_noise(n: int) -> Noise:
    """Arrays (n,) for `standard_noise` and `drift_noise` to fill."""
    z = np.zeros((12, n))
    return Noise(z[0], z[1], z[2], z[3], z[4], z[5], z[6], z[7], z[8], z[9], z[10], z[11])


compiled_blank_noise = inlined(blank_noise)
