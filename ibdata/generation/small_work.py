"""A command that makes few rows does so in plain Python if nothing is compiled yet. The bits are the same.

Compiling takes as long as 40,000 rows, so it is left to the first work that is worth it.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from ibdata._numerics.compiled import interpret, uncompiled
from ibdata._numerics.naming import counted
from ibdata._simulation.kernel import simulate
from ibdata._system import processes
from ibdata.errors import notice
from ibdata.experiment import Experiment
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.fields import BurnIn
from ibdata.policies.network import Network
from ibdata.policies.signals import Multisine
from ibdata.policies.user_object import UserObject

FEW = 20_000  # rows of a command
ENOUGH = 40_000  # rows of several commands, after which the next one compiles
A_SECOND = 3000  # rows that plain Python makes in a second
SLOW = (UserObject, Network, Multisine)  # they compute more than a formula, or what nobody knows
VARIABLES = {"IBDATA_COMPILE", "NUMBA_DISABLE_JIT"}  # with either, nothing is chosen here


def interpret_few_rows(specs: Iterable[DatasetSpec], places: Iterable[Path | str]) -> None:
    """Let this process, if it is a command's, make new datasets in plain Python where that is faster."""
    rows_before = uncompiled(simulate)
    if processes.purpose != "command" or rows_before is None or VARIABLES & os.environ.keys():
        return
    experiments = [experiment for spec in specs for experiment in spec.experiments]
    rows = sum(map(_simulated, experiments))
    slow = any(any(each.everywhere(kind)) for each in experiments for kind in SLOW)
    if rows > FEW or slow or any(map(os.path.lexists, places)):
        return
    try:
        with rows_before.open("ab") as file:  # a byte for a row
            if file.tell() + rows > ENOUGH:
                return
            file.write(bytes(rows))
    except OSError:
        return
    seconds = counted(1 + rows // A_SECOND, "second")
    notice(f"{rows:,} rows in plain Python, about {seconds}; nothing is compiled for so few")
    interpret()


def _simulated(experiment: Experiment) -> int:
    """The rows of an experiment, with the most that a burn-in simulates before them."""
    before = experiment.start.steps[1] if isinstance(experiment.start, BurnIn) else 0
    return experiment.episode_count * (before + experiment.steps)
