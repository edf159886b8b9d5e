"""Random numbers with an address: (seed, cell, index, purpose, step, slot) → 64 bits → a variate.

Philox4x64-10 is a function of a 128-bit key and a 256-bit counter (Salmon, Moraes, Dror and Shaw 2011,
Parallel random numbers: as easy as 1, 2, 3). The key is computed from the seed and the cell's digest, and the
counter holds the rest of the address, so no number depends on earlier draws. Every step has a fixed number of
slots, whether it uses them or not. The integers are those of `numpy.random.Philox`, which adds 1 to its
counter before each block of four.
"""

from __future__ import annotations

import hashlib
from enum import IntEnum
from types import FunctionType
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arrays import Floats
from ibdata._numerics.compiled import compiled, inlined
from ibdata._numerics.exact import normal, normals

Raw = npt.NDArray[np.uint64]
Word = np.uint64
Words = Any  # a number, or in plain Python an array

BLOCK = 4  # integers per value of the counter
ROUNDS = 10
MULTIPLIER_0, MULTIPLIER_1 = Word(0xD2E7470EE14C6C93), Word(0xCA5A826395121157)
WEYL_0, WEYL_1 = Word(0x9E3779B97F4A7C15), Word(0xBB67AE8584CAA73B)
LOW, HALF, ONE = Word(0xFFFFFFFF), Word(32), Word(1)


@compiled
def mulhi(a: np.uint64, b: np.uint64) -> np.uint64:
    """The upper 64 bits of the product of two 64-bit integers, from products of their halves.

    >>> int(mulhi(Word(2**63), Word(6)))
    3
    """
    a_low, a_high, b_low, b_high = a & LOW, a >> HALF, b & LOW, b >> HALF
    low, mixed, other = a_low * b_low, a_low * b_high, a_high * b_low
    carried = ((low >> HALF) + (mixed & LOW) + (other & LOW)) >> HALF
    return a_high * b_high + (mixed >> HALF) + (other >> HALF) + carried


@inlined
def philox(k0: Words, k1: Words, w: Words, x: Words, y: Words, z: Words) -> tuple[Words, Words, Words, Words]:
    """The block for a key (k0, k1) and a counter (w, x, y, z)."""
    for _ in range(ROUNDS):
        high_0, low_0 = mulhi(MULTIPLIER_0, w), MULTIPLIER_0 * w
        high_1, low_1 = mulhi(MULTIPLIER_1, y), MULTIPLIER_1 * y
        w, x, y, z = high_1 ^ x ^ k0, low_1, high_0 ^ z ^ k1, low_0
        k0, k1 = k0 + WEYL_0, k1 + WEYL_1
    return w, x, y, z


@compiled
def philox_blocks(keys: Raw, words: Raw, first: int, purpose: int, out: Raw) -> None:
    """Write the integers of n lanes into out (steps, slots, n).

    Args:
        keys: the keys (2, n).
        words: word 2 of each lane's counter, (n,); word 3 is 0.
        first: the number of the first block; word 0 counts the blocks.
        purpose: word 1.
        out: (steps, slots, n).
    """
    per_step = out.shape[1] // BLOCK
    for t in range(out.shape[0]):
        for b in range(per_step):
            block = Word(first + t * per_step + b) + ONE
            rows = out[t, BLOCK * b : BLOCK * (b + 1)]
            for i in range(words.shape[0]):
                rows[0, i], rows[1, i], rows[2, i], rows[3, i] = philox(
                    keys[0, i], keys[1, i], block, Word(purpose), words[i], Word(0)
                )


class Purpose(IntEnum):
    """The purpose of a stream of random numbers. It is part of the address, so its values must not change."""

    DYNAMICS = 0
    DRIFT = 1
    POLICY = 2
    START = 3
    BURN_IN_DYNAMICS = 4
    BURN_IN_DRIFT = 5
    BURN_IN_POLICY = 6
    EPISODE_POLICY = 7  # once for an episode
    MEASUREMENT = 8
    TRIAL = 9  # of a policy at recorded observations, which is not simulated
    BURN_IN_MEASUREMENT = 10


def stream_key(seed: int, cell_digest: bytes) -> Raw:
    """The Philox key (2,) of a cell for a seed in [0, 2⁶⁴)."""
    digest = hashlib.sha256(b"ibdata noise 1\0" + seed.to_bytes(8, "little") + cell_digest).digest()
    return np.frombuffer(digest[:16], dtype="<u8").astype(np.uint64)


def slots(draws: int) -> int:
    """The number of slots of a step for that many draws, rounded up to whole Philox blocks.

    >>> slots(3), slots(5), slots(0)
    (4, 8, 0)
    """
    return -(-draws // BLOCK) * BLOCK


def integers(
    keys: Raw, indices: npt.NDArray[np.int64], purpose: Purpose, step: int, steps: int, slots: int
) -> Raw:
    """The random integers of n episodes for some steps.

    Args:
        keys: the Philox keys (n, 2), see `stream_key`.
        indices: the indices (n,) of the episodes within their cells.
        purpose: what the integers are for.
        step: the first step.
        steps: the number of steps.
        slots: integers for each step, a multiple of 4.

    Returns:
        Integers (steps, slots, n).
    """
    out = np.empty((steps, slots, len(indices)), dtype=np.uint64)
    words, first = indices.astype(np.uint64), step * slots // BLOCK
    if not isinstance(philox_blocks, FunctionType):
        philox_blocks(np.ascontiguousarray(keys.T), words, first, int(purpose), out)
    else:  # plain Python
        counters = np.arange(first + 1, first + 1 + steps * slots // BLOCK, dtype=np.uint64)[:, None]
        blocks = philox(keys[:, 0], keys[:, 1], counters, Word(purpose), words, Word(0))
        out[:] = np.stack(np.broadcast_arrays(*blocks), axis=1).reshape(out.shape)
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
    """N(0, 1) from U(0, 1), for policies.

    >>> float(standard_normal(0.5))
    0.0
    """
    return normal(u)


@compiled
def uniforms(raw: Raw, out: Floats) -> None:
    """Convert integers (steps, slots, n) to U(0, 1), written into out (steps, n, draws)."""
    for t in range(out.shape[0]):
        for j in range(out.shape[2]):
            for i in range(out.shape[1]):
                out[t, i, j] = uniform(raw[t, j, i])


def normals_of(u: Floats) -> Floats:
    """N(0, 1) from U(0, 1), for an array of any shape."""
    z = np.ascontiguousarray(u).reshape(-1).copy()
    normals(z)
    return z.reshape(u.shape)
