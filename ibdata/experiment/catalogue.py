"""The experiments that come with ibdata, with their sizes and descriptions."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from ibdata.experiment import load
from ibdata.experiment.shipped import shipped, suites
from ibdata.numerics.naming import counted

MODELINE = "# yaml-language-server:"


class Listed(NamedTuple):
    """A shipped experiment, or a folder of them, whose name ends with /."""

    name: str
    rows: int
    description: str


def catalogue() -> list[Listed]:
    """The shipped experiments in order. A folder stands before its experiments."""
    experiments = [Listed(name, load(path).rows, description(path)) for name, path in shipped().items()]
    entries = [entry for entry in experiments if "/" not in entry.name]
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
