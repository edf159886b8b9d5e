"""The experiments that come with ibdata, with their sizes and descriptions."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from ibdata.dataset.tabular import Table, Tabular
from ibdata.experiment import load
from ibdata.experiment.shipped import shipped, suites
from ibdata.numerics.naming import counted

MODELINE = "# yaml-language-server:"


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
