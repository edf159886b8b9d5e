"""Philox4x64-10, a random function of a 128-bit key and a 256-bit counter, for many lanes at a time.

Salmon, Moraes, Dror and Shaw 2011, Parallel random numbers: as easy as 1, 2, 3. The integers are those of
`numpy.random.Philox`, which adds 1 to its counter before it makes a block of four.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ibdata.compiling import compiled

Raw = npt.NDArray[np.uint64]
Word = np.uint64

BLOCK = 4  # integers made at one counter
ROUNDS = 10
MULTIPLIER_0, MULTIPLIER_1 = Word(0xD2E7470EE14C6C93), Word(0xCA5A826395121157)
WEYL_0, WEYL_1 = Word(0x9E3779B97F4A7C15), Word(0xBB67AE8584CAA73B)
LOW, HALF, ONE = Word(0xFFFFFFFF), Word(32), Word(1)


@compiled
def high(a: np.uint64, b: np.uint64) -> np.uint64:
    """The upper 64 bits of the product of two 64-bit integers, from products of their halves.

    >>> int(high(Word(2**63), Word(6)))
    3
    """
    a_low, a_high, b_low, b_high = a & LOW, a >> HALF, b & LOW, b >> HALF
    low, mixed, other = a_low * b_low, a_low * b_high, a_high * b_low
    carried = ((low >> HALF) + (mixed & LOW) + (other & LOW)) >> HALF
    return a_high * b_high + (mixed >> HALF) + (other >> HALF) + carried


@compiled
def philox(
    k0: np.uint64, k1: np.uint64, c0: np.uint64, c1: np.uint64, c2: np.uint64, c3: np.uint64
) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    """The block of four integers at key (k0, k1) and counter (c0, c1, c2, c3)."""
    for _ in range(ROUNDS):
        high_0, low_0 = high(MULTIPLIER_0, c0), MULTIPLIER_0 * c0
        high_1, low_1 = high(MULTIPLIER_1, c2), MULTIPLIER_1 * c2
        c0, c1, c2, c3 = high_1 ^ c1 ^ k0, low_1, high_0 ^ c3 ^ k1, low_0
        k0, k1 = k0 + WEYL_0, k1 + WEYL_1
    return c0, c1, c2, c3


@compiled
def fill(keys: Raw, words: Raw, first: int, purpose: int, out: Raw) -> None:
    """The integers out (steps, slots, n) of lanes with keys (n, 2) and counters that end in words (n,).

    Word 0 of the counter is the number of the block, of which the first is `first`, word 1 the purpose.
    """
    steps, slots, n = out.shape
    per_step = slots // BLOCK
    for t in range(steps):
        for b in range(per_step):
            block = Word(first + t * per_step + b) + ONE
            for i in range(n):
                w, x, y, z = philox(keys[i, 0], keys[i, 1], block, Word(purpose), words[i], Word(0))
                out[t, BLOCK * b, i], out[t, BLOCK * b + 1, i] = w, x
                out[t, BLOCK * b + 2, i], out[t, BLOCK * b + 3, i] = y, z
