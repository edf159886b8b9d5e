"""Compiling the simulator once, before workers start."""

from __future__ import annotations

import sys

from ibdata.experiment import Experiment
from ibdata.simulation import self_check
from ibdata.simulation.rollout import rollout
from ibdata.system.signals import check
from ibdata.writing.statistics import moments, sums


def warm_up(experiment: Experiment) -> bool:
    """Run all compiled code of an experiment on two rows. Return whether the machine computes the right bits.

    A line on stderr tells if the bits are not right.
    """
    small = experiment.part(steps=2, episodes=1)
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
