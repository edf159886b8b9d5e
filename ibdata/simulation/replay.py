"""Play recorded actions of episodes again, which gives the exact states that the episodes passed through."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.dynamics import State
from ibdata.dynamics.variables import FLOATS, INTEGERS
from ibdata.experiment import Experiment
from ibdata.numerics.philox import Raw
from ibdata.numerics.random import Purpose, integers, stream_key
from ibdata.simulation import kernel
from ibdata.simulation.episodes import Episodes, Float32s, Lanes, first_history, put, take
from ibdata.simulation.rollout import CHUNK
from ibdata.simulation.variables import Table, layout

Ints = npt.NDArray[np.int64]


class Visited(NamedTuple):
    """The beginnings of n rows: the states before their actions, and what a policy sees there."""

    state: State
    history: Float32s  # (n, length, 6), newest first

    @classmethod
    def room(cls, n: int, length: int) -> Visited:
        """Room for n rows."""
        floats, whole = np.empty((len(FLOATS), n)), np.empty((len(INTEGERS), n), dtype=np.int64)
        return cls(State(floats, whole), np.empty((n, length, 6), dtype=np.float32))

    def take(self, rows: Ints) -> Visited:
        """A copy of some rows."""
        return Visited(take(self.state, rows), self.history[rows])

    def put(self, rows: Ints, part: Visited) -> None:
        """Write some rows."""
        put(self.state, rows, part.state)
        self.history[rows] = part.history


def replay(
    experiment: Experiment, numbers: Ints, actions: Float32s, lanes: Lanes, steps: Ints, length: int
) -> tuple[Visited, Table]:
    """Play recorded actions again, with the random numbers of the episodes' own addresses.

    Args:
        experiment: the experiment.
        numbers: the episodes (m,), counted in the experiment.
        actions: their first actions (rows, m, 3).
        lanes: for each of n wanted rows, the place of its episode among the numbers (n,).
        steps: the steps (n,) of the wanted rows.
        length: the number of observations that a policy sees.

    Returns:
        The n wanted rows, and the columns of all rows, (columns, m · rows), in the order of `rollout`. No
        policy is asked, so the column of log densities is 0.
    """
    cell_numbers, indices = np.divmod(numbers, experiment.episodes)
    cells = [experiment.cells[i] for i in cell_numbers.tolist()]
    keys = np.array([stream_key(experiment.seed, cell.digest) for cell in cells])

    def draw(some: Lanes, purpose: Purpose, step: int, count: int, slots: int) -> Raw:
        return integers(keys[some], indices[some], purpose, step, count, slots)

    rows, everyone, places = len(actions), np.arange(len(numbers)), layout(experiment)
    episodes = Episodes.of(experiment.start, experiment.drifting, experiment.variant)
    state = episodes.begin(draw, everyone, np.array([cell.setpoint for cell in cells]))
    now = Visited(state, first_history(state, length))
    wanted = Visited.room(len(steps), length)
    table = np.empty((len(places.names), len(numbers) * rows), dtype=experiment.output.dtype)
    record = np.empty((len(places.rows), CHUNK + 1, len(numbers)), dtype=table.dtype)
    unknown = np.zeros((CHUNK, len(numbers)))
    for t, stop in pairwise(sorted({*steps.tolist(), *range(0, rows, CHUNK), rows})):
        here = np.flatnonzero(steps == t)
        wanted.put(here, now.take(lanes[here]))
        record[:, 0] = np.concatenate(state)[places.rows] + 0.0
        raw, drift = episodes.integers(draw, everyone, t + 1, stop - t)
        episodes.advance(state, actions[t:stop], raw, drift, now.history, record, places.rows, 1)
        kernel.scatter_columns(
            record, actions[t:stop], unknown, places.sources, places.first_action, places.log_prob,
            table, t, stop - t, rows,
        )  # fmt: skip
    return wanted, table
