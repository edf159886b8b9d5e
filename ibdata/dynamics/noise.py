"""The noise of one step, in standard form, and how random integers become noise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.numerics.compiled import compiled
from ibdata.numerics.exact import exponential, normals
from ibdata.numerics.random import Raw, uniform

Floats = npt.NDArray[np.float64]

DYNAMICS_SLOTS = 8  # random integers of a step
DRIFT_SLOTS = 4  # further ones, of a moving setpoint
NOISE_ROWS = DYNAMICS_SLOTS + DRIFT_SLOTS


class Noise(NamedTuple):
    """The random numbers of one step of n lanes in standard form: arrays (n,), the rows of a table."""

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


# A uniform draw is below 1, and -log of the least double is below 745.2; no normal draw exceeds 40.
RANGES = {
    "exp": (0.0, 745.2, "Exp(1)"),
    "bernoulli": (0.0, 1.0 - 2.0**-53, "U(0, 1)"),
    "uniform": (0.0, 1.0 - 2.0**-53, "U(0, 1)"),
    "normal": (-40.0, 40.0, "N(0, 1)"),
}
OF_FIELDS = [RANGES[name.partition("_")[0]] for name in Noise._fields]
LOW, HIGH = (np.array([[ends[i]] for ends in OF_FIELDS]) for i in (0, 1))


def checked_noise(noise: Noise, n: int) -> Floats:
    """The noise as a table (12, n). Raises ValueError if a field is not n numbers of its law."""
    draws = [np.asarray(x, dtype=np.float64) for x in noise]
    if any(x.shape != (n,) for x in draws):
        raise _refusal(draws, n)
    table = np.array(draws)
    if not np.all((table >= LOW) & (table <= HIGH)):  # at once, because twelve checks take longer than a step
        raise _refusal(draws, n)
    return table


def _refusal(draws: list[Floats], n: int) -> ValueError:
    wrong = (
        f"step: noise.{name}: found {x}, expected {n} numbers of {law}"
        for name, x, (low, high, law) in zip(Noise._fields, draws, OF_FIELDS, strict=True)
        if x.shape != (n,) or not np.all((x >= low) & (x <= high))
    )
    return ValueError(next(wrong))


@compiled
def standard_noise(raw: Raw, rows: Floats) -> None:
    """Fill the first eight rows, which every step uses, from integers (8, n)."""
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
    """Fill the last four rows, which a moving setpoint uses, from integers (4, n)."""
    for j in range(DRIFT_SLOTS):
        for i in range(raw.shape[1]):
            rows[DYNAMICS_SLOTS + j, i] = uniform(raw[j, i])
