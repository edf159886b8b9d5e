"""The experiments that come with ibdata: their list, and the search for one by path or name."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ibdata._numerics.naming import counted
from ibdata._system.configs import root
from ibdata._system.configs import shipped as shipped
from ibdata.dataset.tabular import Table, Tabular
from ibdata.errors import UsageError, suggestion

MODELINE = "# yaml-language-server:"


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
        short = ", ".join(each for each in known if "/" not in each)
        expected = suggestion(name, known) or f", expected a file or one of {short}"
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


class Listed(NamedTuple):
    """A shipped experiment, or a folder of them, whose name ends with /."""

    name: str
    rows: int
    description: str


class Catalogue(Tabular, list[Listed]):
    """What comes with ibdata."""

    def plain(self) -> dict[str, Any]:
        """The entries as plain data for JSON."""
        return {"configs": [entry._asdict() for entry in self]}

    def tables(self) -> list[Table]:
        """A row for each entry."""
        return [Table(("config", "rows", ""), self)]


def catalogue() -> Catalogue:
    """The shipped experiments in order. A folder stands before its experiments."""
    from ibdata.experiment import load  # which imports this module

    experiments = [Listed(name, load(path).rows, description(path)) for name, path in shipped().items()]
    entries = Catalogue(entry for entry in experiments if "/" not in entry.name)
    for suite in suites():
        members = [entry for entry in experiments if entry.name.startswith(f"{suite}/")]
        rows = sum(member.rows for member in members)
        summary = f"A folder of {counted(len(members), 'experiment')}."
        entries += [Listed(f"{suite}/", rows, summary), *members]
    return entries


def description(path: Path) -> str:
    """The first line of the comment at the top of an experiment file."""
    with path.open(encoding="utf-8") as file:
        comments = (line for line in file if line.startswith("#") and not line.startswith(MODELINE))
        return next(comments, "").removeprefix("#").strip()
