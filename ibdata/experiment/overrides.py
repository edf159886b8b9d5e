"""Overrides: single values of an experiment, replaced before it is checked."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ibdata.errors import Loc, UsageError
from ibdata.experiment.plain import plain
from ibdata.experiment.yaml import MAX_DEPTH, Document, StrictYamlError

Overrides = Sequence[str] | Mapping[str, Any]


def override_all(data: Any, overrides: Overrides, seed: int | None = None) -> dict[Loc, str]:
    """Apply overrides, then the seed, to the data of an experiment.

    Args:
        data: The data, which are changed.
        overrides: Texts `key.sub=value` with values in YAML; or a mapping of keys to values, in which a
            mapping is merged into the one that it meets, unless it is empty.
        seed: The new seed; None leaves it.

    Returns:
        The place that messages give for each path that was changed.

    Raises:
        UsageError: An override is none, or there is no such place in the data.
    """
    if isinstance(overrides, str):
        raise UsageError(f"--set: found the text {overrides!r}, expected a list of such texts, or a mapping")
    if not isinstance(overrides, Sequence | Mapping):
        raise UsageError(f"--set: found {overrides!r}, expected a list of texts, or a mapping")
    places: dict[Loc, str] = {}
    if overrides and isinstance(data.get("policies"), list):
        data["policies"] = [_block(policy) for policy in data["policies"]]
    given = _mapped(data, overrides) if isinstance(overrides, Mapping) else _written(overrides)
    for loc, value, place in given:
        places |= dict.fromkeys(_put(data, loc, value, place), place)
    if seed is not None:
        data["seed"] = seed
        places[("seed",)] = "--seed"
    return places


def _block(policy: Any) -> Any:
    """The block of a policy, which may be given by its bare name, as may its base."""
    if isinstance(policy, str):
        return {"kind": policy}
    if isinstance(policy, dict) and "base" in policy:
        return {**policy, "base": _block(policy["base"])}
    return policy


def _written(overrides: Sequence[str]) -> Iterator[tuple[Loc, Any, str]]:
    """The path, the value and the place of each text `key.sub=value`."""
    for override in overrides:
        key, equals, text = override.partition("=") if isinstance(override, str) else ("", "", "")
        loc = _path(key)
        if not equals or not all(part != "" for part in loc) or len(loc) > MAX_DEPTH:
            raise UsageError(f"--set: found {override!r}, expected key=value")
        try:
            yield loc, Document(text).data, f"--set {override}"
        except StrictYamlError as error:
            raise UsageError(f"--set {override}: {error.message}") from None


def _mapped(data: Any, overrides: Mapping[str, Any], above: Loc = ()) -> Iterator[tuple[Loc, Any, str]]:
    """The same of a mapping. A mapping with values that meets one of its form gives their paths."""
    for key, value in overrides.items():
        loc = (*above, *_path(str(key)))
        if not all(part != "" for part in loc) or len(loc) > MAX_DEPTH:
            raise UsageError(f"--set: found the key {key!r}, expected names joined by dots")
        met = _found(data, loc)
        if isinstance(value, Mapping) and value and isinstance(met, dict) and _same_form(loc, met, value):
            yield from _mapped(data, value, loc)
        else:
            yield loc, plain(value), "--set"


def _path(key: str) -> Loc:
    return tuple(int(part) if re.fullmatch("[0-9]{1,9}", part) else part for part in key.strip().split("."))


def _found(data: Any, loc: Loc) -> Any:
    """The value at a path; None if there is none."""
    for part in loc:
        if isinstance(data, list) and isinstance(part, int) and part < len(data):
            data = data[part]
        else:
            data = data.get(str(part)) if isinstance(data, dict) else None
    return data


def _same_form(loc: Loc, old: Mapping[str, Any], new: Mapping[str, Any]) -> bool:
    """Whether two mappings may be merged: not policies of two kinds, nor a range and `drifting`."""
    if loc == ("setpoints",):
        return ("drifting" in old) == ("drifting" in new)
    return loc[0] != "policies" or new.get("kind", old.get("kind")) == old.get("kind")


def _put(data: Any, loc: Loc, value: Any, place: str) -> list[Loc]:
    """Put a value into the data. Returns the paths of all new values."""
    new: list[Loc] = []
    path: Loc = ()
    for i, part in enumerate(loc):
        last = i == len(loc) - 1
        if isinstance(data, list) and isinstance(part, int) and part < len(data):
            pass
        elif isinstance(data, dict):
            part = str(part)
            if not last and not isinstance(data.get(part), dict | list):
                data[part] = {}
                new.append((*path, part))
        else:
            raise UsageError(f"{place}: there is no {'.'.join(map(str, loc[: i + 1]))} to set")
        path = (*path, part)
        if last:
            data[part] = value
        data = data[part]
    return [*new, path]
