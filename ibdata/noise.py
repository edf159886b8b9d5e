"""Random numbers with an address: (seed, cell, index, purpose, step, slot) → 64 bits → a variate.

Philox4x64-10 is a function of a 128-bit key and a 256-bit counter; NumPy promises that its integers stay
as they are. The key comes from the seed and the cell's digest, the counter holds the rest of the address,
so no number depends on what was drawn before it. Every step owns a fixed number of slots, used or not.
"""

from __future__ import annotations

import hashlib
from enum import IntEnum
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.compiling import compiled
from ibdata.dynamics.exact import exp as exp  # policies take these from here
from ibdata.dynamics.exact import exponential, normal
from ibdata.dynamics.exact import log as log
from ibdata.dynamics.state import Floats, Noise

Raw = npt.NDArray[np.uint64]

BLOCK = 4  # integers that Philox makes at one counter
DYNAMICS_SLOTS = 8
DRIFT_SLOTS = 4


class Purpose(IntEnum):
    """What a stream is for; part of the address, so the values are fixed."""

    DYNAMICS = 0
    DRIFT = 1
    POLICY = 2
    START = 3
    BURN_IN_DYNAMICS = 4
    BURN_IN_DRIFT = 5
    BURN_IN_POLICY = 6


def stream_key(seed: int, cell_digest: bytes) -> Raw:
    """The Philox key (2,) of a cell under a seed in [0, 2⁶⁴)."""
    digest = hashlib.sha256(b"ibdata noise 1\0" + seed.to_bytes(8, "little") + cell_digest).digest()
    return np.frombuffer(digest[:16], dtype="<u8").astype(np.uint64)


def slots(draws: int) -> int:
    """Slots of a step for that many draws: the next whole number of Philox blocks.

    >>> slots(3), slots(5), slots(0)
    (4, 8, 0)
    """
    return -(-draws // BLOCK) * BLOCK


class Source:
    """Philox, set to one address after another (re-keying costs 1 µs, a new generator 7 µs)."""

    def __init__(self) -> None:
        self._philox = np.random.Philox(key=0)
        self._state: dict[str, Any] = dict(self._philox.state)

    def raw(self, key: Raw, index: int, purpose: Purpose, step: int, steps: int, slots: int) -> Raw:
        """The integers (steps, slots) of one episode from `step` on; slots is a multiple of 4."""
        counter = np.array([step * slots // BLOCK, int(purpose), index, 0], dtype=np.uint64)
        self._state["state"] = {"counter": counter, "key": key}
        self._philox.state = self._state  # type: ignore[assignment]  # the type is private to numpy
        return self._philox.random_raw(steps * slots).reshape(steps, slots)

    def lanes(
        self, keys: Raw, indices: npt.NDArray[np.int64], purpose: Purpose, step: int, steps: int, slots: int
    ) -> Raw:
        """The integers (n, steps, slots) of n episodes with keys (n, 2) and indices (n,)."""
        out = np.empty((len(indices), steps, slots), dtype=np.uint64)
        for lane, (key, index) in enumerate(zip(keys, indices.tolist(), strict=True)):
            out[lane] = self.raw(key, index, purpose, step, steps, slots)
        return out


@compiled
def uniform(raw: np.uint64) -> float:
    """U(0, 1) from 52 of 64 random bits: (⌊raw / 2¹²⌋ + ½) · 2⁻⁵², exact and strictly inside.

    >>> uniform(np.uint64(0)) == 2.0**-53, uniform(np.uint64(2**64 - 1)) == 1 - 2.0**-53
    (True, True)
    """
    return (np.float64(raw >> np.uint64(12)) + 0.5) * 2.0**-52


@compiled
def standard_normal(u: float) -> float:
    """N(0, 1) from U(0, 1), for policies, which see nothing of the dynamics.

    >>> float(standard_normal(0.5))
    0.0
    """
    return normal(u)


@compiled
def uniforms(raw: Raw, t: int, out: Floats) -> None:
    """U(0, 1) (n, draws) of step t from integers (n, steps, slots)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = uniform(raw[i, t, j])


@compiled
def standard_noise(raw: Raw, t: int, noise: Noise) -> None:
    """The noise of step t for a constant setpoint, from integers (n, steps, 8); slots in field order."""
    for i in range(raw.shape[0]):
        noise.exp_v[i] = exponential(uniform(raw[i, t, 0]))
        noise.exp_g[i] = exponential(uniform(raw[i, t, 1]))
        noise.bernoulli_v[i] = uniform(raw[i, t, 2])
        noise.bernoulli_g[i] = uniform(raw[i, t, 3])
        noise.uniform_v[i] = uniform(raw[i, t, 4])
        noise.uniform_g[i] = uniform(raw[i, t, 5])
        noise.normal_alpha[i] = normal(uniform(raw[i, t, 6]))
        noise.normal_consumption[i] = normal(uniform(raw[i, t, 7]))


@compiled
def drift_noise(raw: Raw, t: int, noise: Noise) -> None:
    """The noise of step t that a moving setpoint adds, from integers (n, steps, 4)."""
    for i in range(raw.shape[0]):
        noise.uniform_drift_length[i] = uniform(raw[i, t, 0])
        noise.uniform_drift_rate[i] = uniform(raw[i, t, 1])
        noise.uniform_drift_zero[i] = uniform(raw[i, t, 2])
        noise.uniform_drift_flip[i] = uniform(raw[i, t, 3])


def blank_noise(n: int) -> Noise:
    """Arrays (n,) for `standard_noise` and `drift_noise` to fill."""
    return Noise(*(np.zeros(n) for _ in Noise._fields))
