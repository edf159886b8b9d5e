"""Data from Python, such as tuples and numpy's numbers, with the types that YAML gives."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def plain(value: Any) -> Any:
    """A copy in which tuples, ranges and arrays are lists, and numbers of numpy are Python's.

    Whatever is none of these, such as a policy, stays as it is.

    >>> import numpy as np
    >>> plain({"setpoints": np.arange(10, 40, 10), "start": {"burn_in": (1, 2)}})
    {'setpoints': [10, 20, 30], 'start': {'burn_in': [1, 2]}}
    """
    if isinstance(value, Mapping):
        return {key: plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple | range):
        return [plain(inner) for inner in value]
    as_list = getattr(value, "tolist", None)  # of arrays, their numbers, and series of pandas
    return as_list() if callable(as_list) and not isinstance(value, type) else value
