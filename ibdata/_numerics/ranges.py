"""Ranges of numbers, each of a kind."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeVar

Kind = TypeVar("Kind")


def joined(ranges: Iterable[tuple[int, int, Kind]]) -> list[tuple[int, int, Kind]]:
    """Ranges (first, stop, kind) in order, of which those that touch and are of one kind are one.

    >>> joined([(0, 2, "a"), (2, 5, "a"), (5, 6, "b"), (7, 9, "b")])
    [(0, 5, 'a'), (5, 6, 'b'), (7, 9, 'b')]
    """
    found: list[tuple[int, int, Kind]] = []
    for first, stop, kind in ranges:
        if found and found[-1][1] == first and found[-1][2] == kind:
            first = found.pop()[0]
        found.append((first, stop, kind))
    return found
