"""The discount factor of a return, as a user gives it."""

from __future__ import annotations

from numbers import Real
from typing import Any

from ibdata.errors import UsageError
from ibdata.experiment.messages import shown
from ibdata.experiment.plain import plain


def checked_discount(given: Any) -> float:
    """The discount factor as a float. Raises UsageError if it is not a number in [0, 1]."""
    number = plain(given)
    is_number = isinstance(number, Real) and not isinstance(number, bool)
    if not is_number or not 0 <= number <= 1:
        raise UsageError(f"discount: found {shown(number)}, expected a number in [0, 1]")
    return float(number)
