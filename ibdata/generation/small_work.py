"""A command that makes few rows does so in plain Python if nothing is compiled yet. The bits are the same."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from ibdata._numerics.compiled import interpret, uncompiled
from ibdata._numerics.naming import counted
from ibdata._simulation.kernel import simulate
from ibdata._system import processes
from ibdata.errors import notice
from ibdata.generation.place import place_at
from ibdata.plan.dataset_spec import DatasetSpec
from ibdata.policies.network import Network
from ibdata.policies.signals import Multisine
from ibdata.policies.user_object import UserObject

FEW, ENOUGH = 20_000, 40_000  # rows of a command, and of several, which take as long as compiling
A_SECOND = 3000  # rows that plain Python makes in a second
SLOW = (UserObject, Network, Multisine)  # they compute more than a formula, or what nobody knows
MODE_VARIABLES = {"IBDATA_COMPILE", "NUMBA_DISABLE_JIT"}  # with either, nothing is chosen here


def interpret_few_rows(specs: Iterable[DatasetSpec], places: Iterable[Path | str]) -> None:
    """Let this process, if it is a command's, make new datasets in plain Python where that is faster."""
    rows_before = uncompiled(simulate)
    if processes.purpose != "command" or rows_before is None or MODE_VARIABLES & os.environ.keys():
        return
    all_of = [experiment for spec in specs for experiment in spec.experiments]
    # With the most rows that a burn-in simulates.
    rows = sum(e.episode_count * (e.steps + getattr(e.start, "steps", (0, 0))[1]) for e in all_of)
    slow = any(any(each.everywhere(kind)) for each in all_of for kind in SLOW)
    if rows > FEW or slow or any(place_at(place).found() for place in places):
        return
    with suppress(OSError), rows_before.open("ab") as file:  # a byte for a row
        if file.tell() + rows <= ENOUGH:
            file.write(bytes(rows))
            seconds = counted(1 + rows // A_SECOND, "second")
            notice(f"{rows:,} rows in plain Python, about {seconds}; nothing is compiled for so few")
            interpret()
