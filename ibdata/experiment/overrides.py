"""Overrides: single values of an experiment, replaced before it is checked."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from ibdata.arguments import native
from ibdata.errors import Loc, UsageError
from ibdata.experiment.yaml import MAX_DEPTH, Document, StrictYamlError

Overrides = Annotated[Sequence[str] | Mapping[str, Any], "a list of texts key=value, or a mapping"]


def override_all(data: Any, overrides: Overrides) -> set[Loc]:
    """Put overrides into the data of an experiment. Returns the new paths.

    Raises UsageError if an override is not valid, or if its key does not fit the data.
    """
    changed: set[Loc] = set()
    for key, value in map(_parsed, overrides) if isinstance(overrides, Sequence) else overrides.items():
        value = native(value)
        options = {str(key): value}
        if key == "output" and isinstance(value, dict) and value:  # each option of `output` is an override
            options = {f"output.{name}": option for name, option in value.items()}
        changed |= {_put(data, dotted, option) for dotted, option in options.items()}
    return changed


def _parsed(override: str) -> tuple[str, Any]:
    """The dotted key and the value of a text key=value."""
    key, equals, text = override.partition("=")
    if not equals:
        raise UsageError(f"override: found {override!r}, expected key=value")
    try:
        return key.strip(), Document(text).data
    except StrictYamlError as error:
        raise UsageError(f"override {key.strip()}: {error.message}") from None


def _put(data: Any, key: str, value: Any) -> Loc:
    """Put a value at a dotted key. Returns the shortest new path.

    A missing parent becomes a mapping, and the bare name of a policy becomes its block.
    """
    if (dotted := re.sub(r"\.?\[['\"]?(\w+)['\"]?\]", r".\1", key)) != key:
        raise UsageError(f"override: found the key {key!r}; did you mean {dotted!r}?")
    *parents, last = key.split(".")
    if not all([*parents, last]) or len(parents) >= MAX_DEPTH:
        raise UsageError(f"override: found the key {key!r}, expected names joined by dots")
    path: Loc = ()
    new_path: Loc = ()
    for part in parents:
        index = _index(data, part, key)
        path = (*path, index)
        child = data.get(index) if isinstance(data, dict) else data[index]
        if isinstance(child, str) and path[0] == "policies":
            child = data[index] = {"kind": child}
        elif not isinstance(child, dict | list):
            child = data[index] = {}
            new_path = new_path or path
        data = child
    index = _index(data, last, key)
    data[index] = value
    return new_path or (*path, index)


def _index(data: Any, part: str, key: str) -> str | int:
    """The index of a part of a dotted key: a key of a mapping, or a number in a list."""
    if isinstance(data, dict):
        return part
    if re.fullmatch("[0-9]{1,9}", part) and int(part) < len(data):
        return int(part)
    raise UsageError(f"override {key}: there is no item {part}")
