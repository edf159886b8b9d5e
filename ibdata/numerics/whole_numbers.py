"""Whole numbers that a user gives, as arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.errors import UsageError, excerpt

Ints = npt.NDArray[np.int64]


def whole(what: str, value: Any) -> Ints:
    """Whole numbers (n,) from a number or an array, which may be empty."""
    numbers = np.asarray(value)
    if numbers.size == 0:
        numbers = numbers.astype(np.int64)  # whatever its type, as that of []
    if numbers.dtype.kind not in "iu" or numbers.ndim > 1:
        raise UsageError(f"{what}: found {excerpt(value)}, expected whole numbers")
    return np.atleast_1d(numbers).astype(np.int64)


def within(what: str, value: Any, count: int) -> Ints:
    """Whole numbers (n,) from 0 to count - 1."""
    numbers = whole(what, value)
    wrong = (numbers < 0) | (numbers >= count)
    if wrong.any():
        raise UsageError(f"{what}: found {numbers[np.argmax(wrong)]}, expected one of 0 to {count - 1}")
    return numbers
