"""Overrides: single values of an experiment, replaced before it is checked."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any

from ibdata.errors import Loc, UsageError
from ibdata.experiment.plain import plain
from ibdata.experiment.yaml import MAX_DEPTH, Document, StrictYamlError

Overrides = Annotated[Sequence[str] | Mapping[str, Any], "a list of texts key=value, or a mapping"]


def override_all(data: Any, overrides: Overrides) -> set[Loc]:
    """Put overrides into the data of an experiment. Returns the paths that are new.

    Raises UsageError for an override that is none, or for which there is no place in the data.
    """
    return {_put(data, *item) for key, value in _values(overrides) for item in _single(key, value)}


def _single(key: str, value: Any) -> Iterator[tuple[str, Any]]:
    """A mapping for `output`, which has options of its own, as an override of each; others as they are."""
    if key == "output" and isinstance(value, dict) and value:
        yield from ((f"output.{name}", inner) for name, inner in value.items())
    else:
        yield key, value


def _values(overrides: Overrides) -> Iterator[tuple[str, Any]]:
    """The dotted keys and the values."""
    if isinstance(overrides, Mapping):
        yield from ((str(key), plain(value)) for key, value in overrides.items())
        return
    for override in overrides:
        key, equals, text = override.partition("=")
        if not equals:
            raise UsageError(f"override: found {override!r}, expected key=value")
        try:
            yield key.strip(), Document(text).data
        except StrictYamlError as error:
            raise UsageError(f"override {key.strip()}: {error.message}") from None


def _put(data: Any, key: str, value: Any) -> Loc:
    """Put a value at a dotted key. Returns the shortest path that is new.

    What is missing on the way becomes a mapping, and the bare name of a policy becomes its block.
    """
    *above, last = key.split(".")
    if not all([*above, last]) or len(above) >= MAX_DEPTH:
        raise UsageError(f"override: found the key {key!r}, expected names joined by dots")
    path: Loc = ()
    new: Loc = ()
    for part in above:
        step = _place(data, part, key)
        path = (*path, step)
        below = data.get(step) if isinstance(data, dict) else data[step]
        if isinstance(below, str) and path[0] == "policies":
            below = data[step] = {"kind": below}
        elif not isinstance(below, dict | list):
            below = data[step] = {}
            new = new or path
        data = below
    step = _place(data, last, key)
    data[step] = value
    return new or (*path, step)


def _place(data: Any, part: str, key: str) -> str | int:
    """The key in a mapping, or the index in a list, that a part of a dotted key names."""
    if isinstance(data, dict):
        return part
    if re.fullmatch("[0-9]{1,9}", part) and int(part) < len(data):
        return int(part)
    raise UsageError(f"override {key}: there is no item {part}")
