"""Compiling the simulator once, before workers start."""

from __future__ import annotations

import sys

from ibdata.experiment import Experiment
from ibdata.numerics.compiled import is_compiled, is_kept
from ibdata.simulation import self_check
from ibdata.simulation.rollout import rollout
from ibdata.system.signals import check
from ibdata.writing.statistics import moments, sums


def warm_up(experiment: Experiment) -> bool:
    """Run all compiled code of an experiment on two rows. Return whether the machine computes the right bits.

    A line on stderr tells if the simulator is being compiled, and if the bits are not right.
    """
    small = experiment.part(steps=2, episodes=1)
    if not is_compiled():
        print(f"ibdata: compiling the simulator; {_how_often()}", file=sys.stderr, flush=True)
    floats = rollout(small, 0, 1)
    moments(floats.table)
    sums(floats.table[0], 2)
    right = self_check.matches()
    check()
    if not right:
        print(
            "ibdata: this machine computes other bits than expected; the manifest says reproducible: false",
            file=sys.stderr,
        )
    return right


def _how_often() -> str:
    if is_kept():
        return "this happens once and takes up to a minute"
    return (
        "this takes up to a minute in every run, because there is no cache folder that only this user can "
        "write to; set IBDATA_CACHE_DIR to one"
    )
