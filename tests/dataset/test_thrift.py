"""Structures of Thrift's compact protocol."""

from __future__ import annotations

import pytest

from ibdata.dataset.thrift import struct


@pytest.mark.parametrize(
    ("data", "fields"),
    [
        ("00", {}),
        ("1506 00", {1: 3}),
        ("1605 00", {1: -3}),
        ("11 12 00", {1: True, 2: False}),
        ("1802 6162 00", {1: b"ab"}),
        ("05 c801 02 00", {100: 1}),  # the number of the field written out
        ("19 25 02 04 00", {1: [1, 2]}),
        ("19 21 01 02 00", {1: [True, False]}),
        ("1c 15 02 00 15 04 00", {1: {1: 1}, 2: 2}),
        ("1b 00 00", {1: []}),
        ("1b 01 85 01 61 02 00", {1: [[b"a", 1]]}),
        ("17 000000000000f03f 00", {1: bytes.fromhex("000000000000f03f")}),
        ("00 ffff", {}),  # what follows is not part of it
    ],
)
def test_a_structure_is_read(data, fields):
    assert struct(bytes.fromhex(data)) == fields


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("", "found an end in the middle"),
        ("15", "found an end in the middle"),
        ("18ff01 61", "found an end in the middle"),
        ("1502 05 02 02 00", "found the field 1 twice"),
        ("15 ffffffffffffffffffff01 00", "found an integer of more than 64 bits"),
        ("1e 00", "found a value of type 14"),
        ("1c" * 40, "found a value of type 12"),
        ("19 fc ffffffff0f", "found an end in the middle"),
    ],
)
def test_what_is_none_is_an_error(data, message):
    with pytest.raises(ValueError, match=message):
        struct(bytes.fromhex(data))
