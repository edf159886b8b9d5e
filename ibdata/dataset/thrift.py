"""Reading structures of Thrift's compact protocol, in which the footer of a Parquet file is written.

Source: github.com/apache/thrift, doc/specs/thrift-compact-protocol.md
"""

from __future__ import annotations

from typing import Any

Struct = dict[int, Any]  # the values by the numbers of their fields
MAX_DEPTH = 16
TRUE, FALSE, BYTE, DOUBLE, BINARY, LIST, SET, MAP, STRUCT, UUID = 1, 2, 3, 7, 8, 9, 10, 11, 12, 13
INTEGERS = (4, 5, 6)


def struct(data: bytes) -> Struct:
    """The structure with which data begin: integers, bytes, lists and structures.

    >>> struct(bytes([0x15, 0x06, 0x18, 0x01, 0x61, 0x00]))
    {1: 3, 2: b'a'}

    Raises ValueError for data that are not valid, or that have a field twice.
    """
    return struct_and_size(data)[0]


def struct_and_size(data: bytes) -> tuple[Struct, int]:
    """The structure with which data begin, and how many bytes it takes. Raises what `struct` raises."""
    reader = _Reader(data)
    try:
        return reader.struct(0), reader.at
    except IndexError:
        raise ValueError("found an end in the middle of a structure") from None


class _Reader:
    def __init__(self, data: bytes) -> None:
        self._data, self.at = data, 0

    def value(self, kind: int, depth: int) -> Any:
        if kind in INTEGERS:
            number = self._varint()
            return (number >> 1) ^ -(number & 1)
        if kind == BINARY:
            return self._bytes(self._varint())
        if kind == STRUCT and depth < MAX_DEPTH:
            return self.struct(depth + 1)
        if kind in (LIST, SET) and depth < MAX_DEPTH:
            head = self._bytes(1)[0]
            count = self._varint() if head >> 4 == 15 else head >> 4
            return [self._element(head & 15, depth + 1) for _ in range(count)]
        if kind == MAP and depth < MAX_DEPTH:
            count = self._varint()
            kinds = self._bytes(1)[0] if count else 0
            return [[self._element(k, depth + 1) for k in (kinds >> 4, kinds & 15)] for _ in range(count)]
        if kind in (BYTE, DOUBLE, UUID):
            return self._bytes({BYTE: 1, DOUBLE: 8, UUID: 16}[kind])
        raise ValueError(f"found a value of type {kind}, expected one of Thrift's")

    def _element(self, kind: int, depth: int) -> Any:
        return self._bytes(1) == b"\x01" if kind in (TRUE, FALSE) else self.value(kind, depth)

    def struct(self, depth: int) -> Struct:
        fields: Struct = {}
        number = 0
        while head := self._bytes(1)[0]:
            kind = head & 15
            number = number + (head >> 4) if head >> 4 else self.value(INTEGERS[0], depth)
            if number in fields:
                raise ValueError(f"found the field {number} twice")
            fields[number] = kind == TRUE if kind in (TRUE, FALSE) else self.value(kind, depth)
        return fields

    def _varint(self) -> int:
        number = shift = 0
        while True:
            byte = self._data[self.at]
            self.at += 1
            number |= (byte & 127) << shift
            if byte < 128:
                return number
            shift += 7
            if shift > 63:
                raise ValueError("found an integer of more than 64 bits")

    def _bytes(self, count: int) -> bytes:
        end = self.at + count
        if end > len(self._data):
            raise IndexError
        found, self.at = self._data[self.at : end], end
        return found
