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
    """The shipped experiments in order; each folder stands before those in it."""
    single = [Listed(name, load(path).rows, description(path)) for name, path in shipped().items()]
    listed = [experiment for experiment in single if "/" not in experiment.name]
    for suite in suites():
        in_suite = [experiment for experiment in single if experiment.name.startswith(f"{suite}/")]
        rows = sum(experiment.rows for experiment in in_suite)
        listed += [
            Listed(f"{suite}/", rows, f"A folder of {counted(len(in_suite), 'experiment')}."),
            *in_suite,
        ]
    return listed


def description(path: Path) -> str:
    """The first line of the comment with which the file of an experiment begins."""
    with path.open(encoding="utf-8") as file:
        comment = (line for line in file if line.startswith("#") and not line.startswith(MODELINE))
        return next(comment, "").removeprefix("#").strip()
