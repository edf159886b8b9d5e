"""The 27 discrete actions: velocity, gain and shift each change by -1, 0 or 1.

Their order is that of the class `IBGym` of `industrial-benchmark-python` 2.0.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.errors import UsageError, excerpt

Action = tuple[float, float, float]
CHANGES = (-1.0, 0.0, 1.0)
ACTIONS: tuple[Action, ...] = tuple(product(CHANGES, CHANGES, CHANGES))  # of velocity, gain, shift
COUNT = len(ACTIONS)
_TABLE = np.array(ACTIONS, dtype=np.float32)


def discrete_action(given: Any) -> Action:
    """Return the three numbers of a discrete action. Raises UsageError if it is no whole number in 0 … 26.

    >>> discrete_action(0), discrete_action(14)
    ((-1.0, -1.0, -1.0), (0.0, 0.0, 1.0))
    """
    number = given.item() if getattr(given, "shape", None) == () else given  # an integer of NumPy
    if type(number) is int and 0 <= number < COUNT:
        return ACTIONS[number]
    raise _refusal(given, f"a whole number from 0 to {COUNT - 1}")


def discrete_actions(given: Any, used: npt.NDArray[np.bool_]) -> npt.NDArray[np.float32]:
    """Return the actions (n, 3) of whole numbers (n,) in 0 … 26; those of lanes (n,) that use none are zero.

    Raises UsageError for another shape or other numbers.
    """
    try:
        numbers = np.array(given)
    except ValueError:  # rows of different lengths
        numbers = np.empty(0)
    if numbers.shape != used.shape or numbers.dtype.kind not in "iu":
        raise _refusal(given, f"{used.shape} whole numbers from 0 to {COUNT - 1}")
    numbers[~used] = COUNT // 2  # which changes nothing
    if ((numbers < 0) | (numbers >= COUNT)).any():
        raise _refusal(given, f"{used.shape} whole numbers from 0 to {COUNT - 1}")
    return _TABLE.take(numbers, axis=0)


def _refusal(given: Any, expected: str) -> UsageError:
    return UsageError(f"action: found {excerpt(given, 80)}, expected {expected}")
