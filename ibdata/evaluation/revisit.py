"""Simulate episodes again with their recorded actions, which gives the exact states behind their rows."""

from __future__ import annotations

import numpy as np

from ibdata.experiment import Experiment
from ibdata.experiment.columns import layout
from ibdata.experiment.rollout import episodes_of, write_columns
from ibdata.policies import Policy
from ibdata.simulation.carry import Carry, begin
from ibdata.simulation.episodes import Float32s, Ints
from ibdata.simulation.unroll import unroll
from ibdata.simulation.variables import Table


def revisit(
    experiment: Experiment,
    numbers: Ints,
    policy: Policy,
    shown: Ints,
    actions: Float32s,
    lanes: Ints,
    steps: Ints,
) -> tuple[Carry, Table]:
    """Play the recorded actions of episodes, side by side, which a policy watches.

    A policy with a memory is asked at every step, with the random numbers of the episode's own policy. So if
    it is that policy, it remembers what it remembered then.

    Args:
        experiment: the experiment.
        numbers: the numbers (m,) of the episodes in it.
        policy: the policy that watches.
        shown: the numbers (m,) of the episodes in messages.
        actions: the recorded actions (rows, m, 3).
        lanes: the places (n,) of the episodes of wanted rows among the m.
        steps: the steps (n,) of wanted rows.

    Returns:
        Where the episodes are before the wanted rows (n,), and the columns of all rows (columns, m · rows),
        in the order of `rollout`; the column of log densities is 0.
    """
    episodes = episodes_of(experiment, numbers).played_by(policy, number=shown)
    rows, places = len(actions), layout(experiment)
    table = np.empty((len(places.names), len(episodes) * rows), dtype=experiment.output.dtype)
    carry = begin(episodes)
    wanted = carry.take(lanes)  # of the right shape; those at later steps follow
    for block in unroll(episodes, carry, places.rows, rows, recorded=actions, stops=steps.tolist()):
        write_columns(block, places, table, 0, rows)
        here = np.flatnonzero(steps == block.stop)
        wanted.put(here, carry.take(lanes[here]))
    return wanted, table
