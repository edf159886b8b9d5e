"""The experiments that come with ibdata, and the search for an experiment by path or name."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from ibdata.errors import UsageError, suggestion
from ibdata.system.configs import root
from ibdata.system.configs import shipped as shipped


def shipped_name(path: Path | None) -> str | None:
    """The name of a config that comes with ibdata; None for another file."""
    return next((name for name, config in shipped().items() if config == path), None)


def suites() -> dict[str, Path]:
    """The folders of configs that come with ibdata, by name."""
    return {path.name: path for path in sorted(root().iterdir()) if is_suite(path)}


def is_suite(path: Path) -> bool:
    """Whether a path is a folder that holds configs."""
    return os.path.isdir(path) and any(path.glob("[!.]*.yaml"))


def find(config: str | os.PathLike[str]) -> Path:
    """Find a config file or a folder of configs, by path or else by shipped name, with or without '.yaml'.

    A folder without configs is ignored. Raises UsageError if there is no match.
    """
    path = Path(os.path.expanduser(config))
    if os.path.exists(path) and (not os.path.isdir(path) or is_suite(path)):  # False for an invalid name
        return path
    known = {**shipped(), **suites()}
    name = os.fspath(config).removesuffix("/").removesuffix(".yaml")
    if name and name not in known and os.path.isdir(path):
        raise UsageError(
            f"config: found the folder {os.fspath(config)!r} without a file *.yaml, expected one with such "
            "files, each an experiment; ibdata init makes a first one"
        )
    if name not in known:
        expected = suggestion(name, known) or f", expected a file or one of {', '.join(_short(known))}"
        raise UsageError(f"config: found {os.fspath(config)!r}{expected}")
    return known[name]


def full_name(what: str, name: str, sets: Sequence[str]) -> str:
    """The name with its suite of the set that is named with or without it, where that leaves no doubt.

    Raises UsageError if none of the sets has the name.
    """
    ends = [path.rpartition("/")[2] for path in sets]
    short = [end if ends.count(end) == 1 else path for path, end in zip(sets, ends, strict=True)]
    for path, end in zip(sets, short, strict=True):
        if name in (path, end):
            return path
    expected = suggestion(name, [*sets, *short]) or f", expected one of {', '.join(short)}"
    raise UsageError(f"{what}: found {name!r}{expected}")


def _short(names: Iterable[str]) -> list[str]:
    """The shipped names, without those inside suites."""
    return [name for name in names if "/" not in name]
