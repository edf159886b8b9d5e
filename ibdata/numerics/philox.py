"""Philox4x64-10, a random function of a 128-bit key and a 256-bit counter, for many lanes at a time.

Salmon, Moraes, Dror and Shaw 2011, Parallel random numbers: as easy as 1, 2, 3. The integers are those of
`numpy.random.Philox`, which adds 1 to its counter before each block of four.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ibdata.numerics.compiled import compiled

Raw = npt.NDArray[np.uint64]
Word = np.uint64

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


@compiled
def philox(keys: Raw, c0: np.uint64, c1: np.uint64, c2: Raw, c3: np.uint64, out: Raw) -> None:
    """Write the blocks for keys (2, n) and counters (c0, c1, c2, c3), where c2 is (n,), into out (4, n)."""
    for i in range(c2.shape[0]):
        k0, k1 = keys[0, i], keys[1, i]
        w, x, y, z = c0, c1, c2[i], c3
        for _ in range(ROUNDS):
            high_0, low_0 = mulhi(MULTIPLIER_0, w), MULTIPLIER_0 * w
            high_1, low_1 = mulhi(MULTIPLIER_1, y), MULTIPLIER_1 * y
            w, x, y, z = high_1 ^ x ^ k0, low_1, high_0 ^ z ^ k1, low_0
            k0, k1 = k0 + WEYL_0, k1 + WEYL_1
        out[0, i], out[1, i], out[2, i], out[3, i] = w, x, y, z


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
            philox(keys, block, Word(purpose), words, Word(0), out[t, BLOCK * b : BLOCK * (b + 1)])
