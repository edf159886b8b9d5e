"""Convert random integers to the noise of one step of the dynamics."""

from __future__ import annotations

from ibdata.dynamics.state import Floats, Noise
from ibdata.numerics.compiled import compiled, inlined
from ibdata.numerics.exact import exponential, normals
from ibdata.numerics.philox import Raw
from ibdata.numerics.random import uniform

DYNAMICS_SLOTS = 8
DRIFT_SLOTS = 4
NOISE_ROWS = DYNAMICS_SLOTS + DRIFT_SLOTS


@compiled
def standard_noise(raw: Raw, rows: Floats) -> None:
    """Fill the first eight rows, which every step uses, from integers (8, n); see `fields`."""
    for j in range(2):
        for i in range(raw.shape[1]):
            rows[j, i] = exponential(uniform(raw[j, i]))
    for j in range(2, DYNAMICS_SLOTS):
        for i in range(raw.shape[1]):
            rows[j, i] = uniform(raw[j, i])
    normals(rows[6])
    normals(rows[7])


@compiled
def drift_noise(raw: Raw, rows: Floats) -> None:
    """Fill the last four rows, which a moving setpoint uses, from integers (4, n); see `fields`."""
    for j in range(DRIFT_SLOTS):
        for i in range(raw.shape[1]):
            rows[DYNAMICS_SLOTS + j, i] = uniform(raw[j, i])


@inlined
def fields(z: Floats) -> Noise:
    """Rows (12, n) as the fields of a noise."""
    return Noise(z[0], z[1], z[2], z[3], z[4], z[5], z[6], z[7], z[8], z[9], z[10], z[11])
