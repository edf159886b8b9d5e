"""Philox4x64-10 against the known answers of its authors' Random123 (kat_vectors), and exact products."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.examples import tries
from hypothesis import example, given
from hypothesis import strategies as st

from ibdata.numerics.philox import Word, mulhi, philox

examples = tries(200)
words = st.integers(0, 2**64 - 1)
MOST = 2**64 - 1
# Key, counter, block; the last from the digits of pi.
KNOWN = [
    ((0, 0), (0, 0, 0, 0), "16554d9eca36314c db20fe9d672d0fdc d7e772cee186176b 7e68b68aec7ba23b"),
    ((MOST, MOST), (MOST,) * 4, "87b092c3013fe90b 438c3c67be8d0224 9cc7d7c69cd777b6 a09caebf594f0ba0"),
    (
        (0x452821E638D01377, 0xBE5466CF34E90C6C),
        (0x243F6A8885A308D3, 0x13198A2E03707344, 0xA4093822299F31D0, 0x082EFA98EC4E6C89),
        "a528f45403e61d95 38c72dbd566e9788 a5a1610e72fd18b5 57bd43b5e52b7fe6",
    ),
]


@pytest.mark.parametrize(("key", "counter", "block"), KNOWN, ids=["zeros", "ones", "pi"])
def test_a_block_is_that_of_the_known_answer(key, counter, block):
    c0, c1, c2, c3 = map(Word, counter)
    out = np.empty((4, 1), dtype=np.uint64)
    philox(np.array(key, dtype=np.uint64).reshape(2, 1), c0, c1, np.array([c2]), c3, out)
    assert [f"{x:016x}" for x in out[:, 0].tolist()] == block.split()


@examples
@example(MOST, MOST)
@example(2**32, 2**32)
@given(words, words)
def test_high_is_the_upper_half_of_the_exact_product(a, b):
    assert int(mulhi(Word(a), Word(b))) == a * b >> 64
