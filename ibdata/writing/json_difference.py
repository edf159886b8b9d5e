"""The first difference of JSON data."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any


def first_difference(found: Any, expected: Any, *keys: object) -> str | None:
    """Describe the first difference of JSON data, which are at `keys`; None if they are equal.

    >>> first_difference({"a": [1, 2]}, {"a": [1, 3]})
    'a.1: found 2, expected 3'
    """
    pairs: Iterable[tuple[object, Any, Any]] = ()
    if isinstance(found, dict) and isinstance(expected, dict):
        pairs = [(key, found.get(key), expected.get(key)) for key in {**expected, **found}]
    elif isinstance(found, list) and isinstance(expected, list) and len(found) == len(expected):
        pairs = zip(range(len(found)), found, expected, strict=True)
    elif found != expected or isinstance(found, bool) != isinstance(expected, bool):
        place = f"{'.'.join(map(str, keys))}: " if keys else ""
        return f"{place}found {_shown(found)}, expected {_shown(expected)}"
    for key, a, b in pairs:
        if inner := first_difference(a, b, *keys, key):
            return inner
    return None


def _shown(value: Any) -> str:
    return f"{len(value)} values" if isinstance(value, list) else json.dumps(value)[:60]
