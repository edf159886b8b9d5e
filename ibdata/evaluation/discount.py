"""The discount factor of a return, as a user gives it."""

from __future__ import annotations

from typing import Any

from ibdata.errors import UsageError
from ibdata.experiment.messages import shown
from ibdata.experiment.plain import plain


def checked_discount(given: Any) -> float:
    """The discount factor as a float. Raises UsageError if it is not a number in [0, 1]."""
    number = plain(given)
    if isinstance(number, bool) or not isinstance(number, int | float) or not 0 <= number <= 1:
        raise UsageError(f"discount: found {shown(number)}, expected a number in [0, 1]")
    return float(number)
