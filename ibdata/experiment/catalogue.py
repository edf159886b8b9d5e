"""The list of the experiments that come with ibdata, and the template of a new one."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import TypeAdapter, ValidationError

from ibdata._numerics.naming import counted, yaml_name
from ibdata._system.configs import canonical_file
from ibdata._system.storage import local
from ibdata.dataset.tabular import Table, Tabular
from ibdata.errors import IbdataError, UsageError, suggestion
from ibdata.experiment import load, shipped, suites
from ibdata.experiment.fields import FileName

MODELINE = "# yaml-language-server:"


def full_name(what: str, name: str, sets: Sequence[str]) -> str:
    """The full name of a set, such as suite/set; the suite may be left out where that leaves no doubt.

    Raises UsageError if none of the sets has the name.
    """
    ends = [path.rpartition("/")[2] for path in sets]
    short = {end if ends.count(end) == 1 else path: path for path, end in zip(sets, ends, strict=True)}
    known = {**{path: path for path in sets}, **short}
    if name not in known:
        expected = suggestion(name, known) or f", expected one of {', '.join(short)}"
        raise UsageError(f"{what}: found {name!r}{expected}")
    return known[name]


class Listed(NamedTuple):
    """A shipped experiment, or a folder of them, whose name ends with /."""

    name: str
    rows: int
    description: str
    content_root: str | None = None  # None for a folder


class Catalogue(Tabular, list[Listed]):
    """What comes with ibdata."""

    def plain(self) -> dict[str, Any]:
        """The entries as plain data for JSON."""
        return {"configs": [entry._asdict() for entry in self]}

    def tables(self) -> list[Table]:
        """A row for each entry, without the content roots."""
        return [Table(("config", "rows", ""), [entry[:3] for entry in self])]


def catalogue() -> Catalogue:
    """The shipped experiments in order. A folder stands before its experiments."""
    known = json.loads(canonical_file().read_text(encoding="utf-8"))
    experiments = [
        Listed(name, load(path).rows, description(path), known[name]["content_root"])
        for name, path in shipped().items()
    ]
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


TEMPLATE = """\
# An experiment of ibdata, which determines the contents of a dataset.
name: {name}

# siemens: the authors' code, with which nearly all published results were made.
# paper: the equations as printed. A variant with single fields replaced: {{base: siemens, eta_mean: 0.05}}
dynamics: siemens

# In [0, 100]: a number, a list, a range that includes its stop, or moving: drifting, {{drifting: [10, 50]}}
setpoints: {{start: 10, stop: 100, step: 10}}

# Each policy is combined with each setpoint; `ibdata config policies` lists them with their options.
policies:
  - kind: random
  - kind: epsilon_greedy
    base: {{kind: optimized}}
    epsilon: 0.4
    name: explored              # label in the data; by default the kind

episodes: 2                     # of each setpoint and policy
steps: 1000                     # rows of an episode

# default: velocity = gain = shift = 50; uniform: each uniform in [0, 100]
# {{burn_in: [15, 64]}}: default, then 15 to 64 random steps before the first row
start: default
seed: 0

output:
  dtype: float32                # or float64
  latent: true                  # the hidden state; or false, full (with derived values), next (also at t + 1)

# Named sets of episodes, stored in files of their own: by setpoint, policy, and episodes of each combination.
splits:
  source: {{setpoint: 50}}
  target: {{setpoint: 70, episodes: 1}}

licence: CC-BY-4.0              # of the dataset, an SPDX expression
"""


def write_template(file: str | os.PathLike[str]) -> None:
    """Write the template into a new file and name the experiment after the file.

    Raises UsageError if the file exists, and IbdataError if it cannot be written.
    """
    path = local(file)
    try:
        name = TypeAdapter(FileName).validate_python(path.stem)
    except ValidationError:
        name = "experiment"
    try:
        with path.open("x", encoding="utf-8") as stream:
            stream.write(TEMPLATE.format(name=yaml_name(name)))
    except FileExistsError:
        raise UsageError(f"{path}: exists already; choose another name") from None
    except OSError as error:
        raise IbdataError(f"{path}: cannot be written: {error.strerror}") from None
