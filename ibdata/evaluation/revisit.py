"""Simulate episodes again with their recorded actions, which gives the exact states behind their rows."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ibdata.experiment import Experiment
from ibdata.experiment.columns import layout
from ibdata.experiment.rollout import lanes_of
from ibdata.policies import Policy
from ibdata.simulation import kernel
from ibdata.simulation.driver import CHUNK, Run, Situation
from ibdata.simulation.variables import Table
from ibdata.simulation.world import Float32s, Ints


def revisited(
    experiment: Experiment,
    numbers: Ints,
    watching: Policy,
    shown: Ints,
    actions: Float32s,
    lanes: Ints,
    steps: Ints,
) -> tuple[Situation, Table]:
    """Play the recorded actions of episodes, side by side, which a policy watches.

    A policy with a memory is asked at every step, with the random numbers of the episode's own policy. So if
    it is that policy, it remembers what it remembered then.

    The m episodes have these numbers in the experiment, others in messages, and begin with these actions
    (rows, m, 3). Lanes and steps (n,) are those of wanted rows. Returns their situations and the columns of
    all rows (columns, m · rows), in the order of `rollout`; the column of log densities is 0.
    """
    own = lanes_of(experiment, numbers)._replace(policy=watching, label=watching.label, numbers=shown)
    run, rows, places = Run(experiment.world, own), len(actions), layout(experiment)
    wanted = Situation.room(len(steps), run.needs)
    table = np.empty((len(places.names), run.n * rows), dtype=experiment.output.dtype)
    record = np.empty((len(places.rows), CHUNK + 1, run.n))
    unknown, ignored = np.zeros((CHUNK, run.n)), np.empty((run.n, 3), dtype=np.float32)
    span = 1 if run.needs.memory else CHUNK
    for t, stop in pairwise(sorted({*steps.tolist(), *range(0, rows, span), rows})):
        here = np.flatnonzero(steps == t)
        wanted.put(here, run.situation.take(lanes[here]))
        if run.needs.memory:
            [given] = run.questions(t, 1)
            _, run.memory = run.asked.decide(given, ignored)
        record[:, 0] = np.concatenate(run.state)[places.rows] + 0.0
        raw, drift = run.world.integers(own.draw, run.everyone, t + 1, stop - t)
        run.world.advance(run.state, actions[t:stop], raw, drift, run.past, record, places.rows, 1)
        kernel.scatter_columns(
            record, actions[t:stop], unknown, places.sources, places.first_action, places.log_prob,
            table, t, stop - t, rows,
        )  # fmt: skip
    return wanted, table
