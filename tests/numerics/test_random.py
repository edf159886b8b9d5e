"""Random numbers by address.

The golden numbers were printed by

    python -c "import hashlib; from ibdata._numerics.random import *;
    key = stream_key(7, hashlib.sha256(b'golden').digest());
    print([hex(x) for x in key.tolist()]);
    print([hex(x) for x in integers(key[None], np.array([3]), Purpose.POLICY, 5, 1, 8)[0, :, 0].tolist()])"

with numpy 2.4.6; Philox's integers and SHA-256 are the same in every version.
"""

from __future__ import annotations

import hashlib

import numpy as np
import pytest
from helpers import tries
from hypothesis import given
from hypothesis import strategies as st

from ibdata._numerics import exact
from ibdata._numerics.random import Purpose, Word, integers, philox, stream_key, uniform
from ibdata.dynamics.noise import DRIFT_SLOTS, DYNAMICS_SLOTS, NOISE_ROWS, Noise, drift_noise, standard_noise

examples = tries(200)

CELL = hashlib.sha256(b"golden").digest()
GOLDEN_KEY = ["0xd22f8da3cafac0de", "0x9ab1da974e4d3384"]
GOLDEN_RAW = """
0x7ca627192591b474 0x7c163de0af7079 0xaf27ef0ce7218592 0x6cc9d1da9255d381
0x6439049567ddf7e1 0xb4594e440b42c8bb 0xf05ac669a49a37ee 0x81af38be4b44223c
"""
# The slot of every field, and what makes the field of the slot's uniform.
STANDARD = {
    **{"exp_v": (0, exact.exponential), "exp_g": (1, exact.exponential)},
    **{f"{name}_{side}": (2 * i + j, float) for i, name in enumerate(("bernoulli", "uniform"), start=1)
       for j, side in enumerate("vg")},
    **{"normal_alpha": (6, exact.normal), "normal_consumption": (7, exact.normal)},
}  # fmt: skip
DRIFT = {f"uniform_drift_{name}": (i, float) for i, name in enumerate(("length", "rate", "zero", "flip"))}


def raw(seed=7, cell=CELL, index=3, purpose=Purpose.POLICY, step=5, steps=1, count=8):
    return lane(stream_key(seed, cell), index, purpose, step, steps, count)


def lane(key, index, purpose, step, steps, count):
    """The integers (steps, count) of one episode."""
    return integers(key[None], np.array([index]), purpose, step, steps, count)[:, :, 0]


def by_numpy(key, index, purpose, step, steps, count):
    """The same integers from a new generator: word 0 of the counter is the number of the block."""
    counter = [step * count // 4, int(purpose), index, 0]
    return np.random.Philox(key=key, counter=counter).random_raw(steps * count).reshape(steps, count)


def some_raw(*shape):
    return np.random.Philox(key=1).random_raw(int(np.prod(shape))).reshape(shape)


def test_the_key_and_the_integers_of_an_address_never_change():
    assert [hex(x) for x in stream_key(7, CELL).tolist()] == GOLDEN_KEY
    assert [hex(x) for x in raw()[0].tolist()] == GOLDEN_RAW.split()


@examples
@given(
    seed=st.integers(0, 2**64 - 1),
    index=st.integers(0, 2**48 - 1),
    purpose=st.sampled_from(Purpose),
    step=st.integers(0, 2**31 - 1),
    steps=st.integers(1, 5),
    blocks=st.integers(1, 3),
)
def test_integers_are_those_of_a_new_philox_at_the_address(seed, index, purpose, step, steps, blocks):
    key = stream_key(seed, CELL)
    np.testing.assert_array_equal(
        lane(key, index, purpose, step, steps, 4 * blocks),
        by_numpy(key, index, purpose, step, steps, 4 * blocks),
    )


@examples
@given(st.integers(0, 2**64 - 1))
def test_a_uniform_is_the_upper_52_bits_and_a_half_exactly(integer):
    u = float(uniform(np.uint64(integer)))
    assert u * 2**53 == 2 * (integer >> 12) + 1
    assert 0.0 < u < 1.0


@pytest.mark.parametrize(
    ("convert", "slots", "table"),
    [(standard_noise, DYNAMICS_SLOTS, STANDARD), (drift_noise, DRIFT_SLOTS, DRIFT)],
)
def test_each_slot_is_transformed_into_its_field_alone(convert, slots, table):
    drawn, rows = some_raw(slots, 500), np.zeros((NOISE_ROWS, 500))
    convert(drawn, rows)
    for field, values in Noise(*rows)._asdict().items():
        slot, transform = table.get(field, (0, lambda u: 0.0))
        assert values.tolist() == [transform(uniform(x)) for x in drawn[slot]], field


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
    with np.errstate(over="ignore"):  # of numbers, where nothing is compiled
        words = philox(*map(Word, (*key, *counter)))
    assert [f"{int(word):016x}" for word in words] == block.split()
