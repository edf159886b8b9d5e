"""Actions as agents give them: three numbers, or one of 27 discrete actions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.errors import UsageError, excerpt
from ibdata.policies.distributions import DISCRETE, NUMBERED, Action, clip_and_round, is_discrete, of_discrete

NUMBERS = "finite numbers: changes of velocity, gain and shift in [-1, 1]"


def continuous_action(action: Any) -> Action:
    """The three numbers of an action. Raises UsageError if it is none."""
    try:
        dv, dg, dh = map(float, action.tolist() if isinstance(action, np.ndarray) else action)
        finite = math.isfinite(dv) and math.isfinite(dg) and math.isfinite(dh)
    except (TypeError, ValueError):
        finite = False
    if not finite:
        raise _refusal(action, f"three {NUMBERS}")
    return dv, dg, dh


def continuous_actions(actions: Any, n: int) -> npt.NDArray[np.float32]:
    """Actions (n, 3), clipped to [-1, 1] and rounded. Raises UsageError if they are none."""
    try:
        proposed = np.asarray(actions, dtype=np.float64)
    except (TypeError, ValueError):  # rows of different lengths, or no numbers
        proposed = np.empty(0)
    out = np.empty((n, 3), dtype=np.float32)
    if proposed.shape != out.shape or clip_and_round(proposed, out) < 0:
        raise _refusal(actions, f"({n}, 3) {NUMBERS}")
    return out


def discrete_action(action: Any) -> Action:
    """The three numbers of a discrete action. Raises UsageError if it is none.

    >>> discrete_action(0), discrete_action(14)
    ((-1.0, -1.0, -1.0), (0.0, 0.0, 1.0))
    """
    number = action.item() if getattr(action, "shape", None) == () else action  # an integer of NumPy
    if type(number) is not int or not 0 <= number < len(DISCRETE):
        raise _refusal(action, f"a whole number {NUMBERED}")
    return DISCRETE[number]


def discrete_actions(actions: Any, n: int) -> npt.NDArray[np.float32]:
    """The actions (n, 3) of n discrete ones. Raises UsageError if they are none."""
    try:
        numbers = np.asarray(actions)
    except ValueError:  # rows of different lengths
        numbers = np.empty(0)
    converted = of_discrete(numbers) if is_discrete(numbers) and len(numbers) == n else None
    if converted is None:
        raise _refusal(actions, f"{n} whole numbers {NUMBERED}")
    return converted


def _refusal(action: Any, expected: str) -> UsageError:
    return UsageError(f"action: found {excerpt(action, 80)}, expected {expected}")
