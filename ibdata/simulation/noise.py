"""Convert random integers to the noise of one step of the dynamics."""

from __future__ import annotations

import numpy as np

from ibdata.dynamics.state import Floats, Noise
from ibdata.numerics.compiled import compiled
from ibdata.numerics.exact import exponential, normals
from ibdata.numerics.philox import Raw
from ibdata.numerics.random import uniform

DYNAMICS_SLOTS = 8
DRIFT_SLOTS = 4


@compiled
def _uniforms(raw: Raw, out: Floats) -> None:
    for i in range(out.shape[0]):
        out[i] = uniform(raw[i])


@compiled
def _exponentials(raw: Raw, out: Floats) -> None:
    for i in range(out.shape[0]):
        out[i] = exponential(uniform(raw[i]))


@compiled
def standard_noise(raw: Raw, noise: Noise) -> None:
    """Fill the fields that every step uses, in their order, from integers (8, n)."""
    _exponentials(raw[0], noise.exp_v)
    _exponentials(raw[1], noise.exp_g)
    _uniforms(raw[2], noise.bernoulli_v)
    _uniforms(raw[3], noise.bernoulli_g)
    _uniforms(raw[4], noise.uniform_v)
    _uniforms(raw[5], noise.uniform_g)
    _uniforms(raw[6], noise.normal_alpha)
    _uniforms(raw[7], noise.normal_consumption)
    normals(noise.normal_alpha)
    normals(noise.normal_consumption)


@compiled
def drift_noise(raw: Raw, noise: Noise) -> None:
    """Fill the fields that a moving setpoint uses, in their order, from integers (4, n)."""
    _uniforms(raw[0], noise.uniform_drift_length)
    _uniforms(raw[1], noise.uniform_drift_rate)
    _uniforms(raw[2], noise.uniform_drift_zero)
    _uniforms(raw[3], noise.uniform_drift_flip)


def blank_noise(n: int) -> Noise:
    """Arrays (n,) for `standard_noise` and `drift_noise` to fill."""
    z = np.zeros((12, n))
    return Noise(z[0], z[1], z[2], z[3], z[4], z[5], z[6], z[7], z[8], z[9], z[10], z[11])


compiled_blank_noise = compiled(blank_noise)
