"""Calls that are refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from ibdata.errors import IbdataError, UsageError


def refused(
    line: str, call: Callable[..., Any], *args: Any, error: type[IbdataError] = UsageError, **options: Any
) -> str:
    """Check that a call raises an error of one line in which a pattern is found; return the line."""
    __tracebackhide__ = True
    with pytest.raises(error, match=line) as found:
        call(*args, **options)
    assert "\n" not in str(found.value)
    return str(found.value)
