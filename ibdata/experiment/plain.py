"""Convert data from Python, such as tuples and numbers of numpy, to the types of YAML."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def plain(value: Any) -> Any:
    """A copy in which tuples, ranges and arrays are lists, and numbers of numpy are Python's.

    Any other value, such as a policy, stays as it is.

    >>> import numpy as np
    >>> plain({"setpoints": np.arange(10, 40, 10), "start": {"burn_in": (1, 2)}})
    {'setpoints': [10, 20, 30], 'start': {'burn_in': [1, 2]}}
    """
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | range):
        return [plain(item) for item in value]
    as_list = getattr(value, "tolist", None)  # arrays and numbers of numpy and series of pandas have it
    return as_list() if callable(as_list) and not isinstance(value, type) else value
