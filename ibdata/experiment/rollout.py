"""Simulate episodes of an experiment into columns, as a pure function."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ibdata.experiment.cells import Cell
from ibdata.experiment.columns import Layout, layout
from ibdata.experiment.models import Experiment
from ibdata.numerics.random import Purpose, stream_key
from ibdata.policies.mixture import Mixture
from ibdata.simulation import kernel
from ibdata.simulation.driver import CHUNK, LANES, Lanes, Run
from ibdata.simulation.variables import Table
from ibdata.simulation.world import Ints, draw_uniforms

LEAST_LANES = 64
# Rows of a table, which is encoded while the next is filled. The last bits of the statistics depend on it.
PART_ROWS = 2**18


class Columns(NamedTuple):
    """The float columns of some episodes, rows ordered by (episode, step)."""

    names: tuple[str, ...]
    table: Table  # (columns, rows)
    clipped: int  # number of actions that were clipped


class Memory:
    """The memory of one table, which each `rollout` of a thread uses again."""

    def __init__(self) -> None:
        self._bytes = np.empty(0, np.uint8)

    def table(self, shape: tuple[int, int], dtype: str) -> Table:
        """A table with any content; the one before it is gone."""
        size = shape[0] * shape[1] * np.dtype(dtype).itemsize
        if size > len(self._bytes):
            self._bytes = np.empty(size, np.uint8)
        return self._bytes[:size].view(dtype).reshape(shape)


def rollout(experiment: Experiment, first: int, stop: int, memory: Memory | None = None) -> Columns:
    """Simulate episodes first … stop - 1 of a dataset into a table, whose memory may be used again.

    Raises PolicyError, which names policy, episode and step, for an action that is not valid.
    """
    places = layout(experiment)
    shape = len(places.names), (stop - first) * experiment.steps
    table = (memory or Memory()).table(shape, experiment.output.dtype)
    clipped = 0
    for start, end in blocks(experiment, first, stop):
        run = Run(experiment.world, lanes_of(experiment, np.arange(start, end)))
        clipped += _fill(table, (start - first) * experiment.steps, run, places)
    return Columns(places.names, table, clipped)


def parts(experiment: Experiment, first: int, stop: int) -> Iterator[tuple[int, int]]:
    """Split episodes first … stop - 1 into parts, each of which is simulated into one table.

    A part has at most PART_ROWS rows, in whole blocks. If a block would have more, a part has as many
    episodes as fit but at least LEAST_LANES, because fewer lanes are simulated slowly.
    """
    most = PART_ROWS // experiment.steps
    most = most // LANES * LANES or max(most, LEAST_LANES)
    for start in range(first, stop, most):
        yield start, min(stop, start + most)


def blocks(experiment: Experiment, first: int, stop: int) -> Iterator[tuple[int, int]]:
    """Split episodes first … stop - 1 into blocks of at most LANES episodes with the same policy."""
    per_policy = _per_policy(experiment)
    while first < stop:
        end = min(stop, first + LANES, (first // per_policy + 1) * per_policy)
        yield first, end
        first = end


def lanes_of(experiment: Experiment, numbers: Ints) -> Lanes:
    """Episodes of these numbers (n,), with the policy of the first of them and at their own addresses."""
    cells, own, indices = cells_of(experiment, numbers)
    keys = np.array([stream_key(experiment.seed, cell.digest) for cell in cells])[own]
    setpoints = np.array([cell.setpoint for cell in cells])[own]
    return Lanes(cells[0].policy, keys, keys, indices, setpoints, cells[0].label, numbers)


def cells_of(experiment: Experiment, numbers: Ints) -> tuple[list[Cell], Ints, Ints]:
    """The cells of episodes of these numbers (n,), and for each its place among them and its index there."""
    cell_numbers, indices = np.divmod(numbers, experiment.episodes)
    found, own = np.unique(cell_numbers, return_inverse=True)
    return [experiment.cells[i] for i in found.tolist()], own, indices


def acting_in(experiment: Experiment, numbers: Ints) -> list[str]:
    """The policy that acts in each of these episodes (n,): of a mixture the one that is drawn for it."""
    acting = np.array(experiment.labels, dtype=object)[numbers // _per_policy(experiment)]
    for place, policy in enumerate(experiment.policies):
        here = np.flatnonzero(numbers // _per_policy(experiment) == place)
        if isinstance(policy, Mixture) and len(here):
            lanes = lanes_of(experiment, numbers[here])
            [u] = draw_uniforms(lanes.draw, np.arange(len(here)), Purpose.EPISODE_POLICY, 0, 1, 1)
            acting[here] = np.array(policy.members, dtype=object)[policy.member(u[:, 0])]
    return list(map(str, acting))


def _per_policy(experiment: Experiment) -> int:
    return experiment.episodes * (len(experiment.cells) // len(experiment.policies))


def _fill(table: Table, row: int, run: Run, places: Layout) -> int:
    """Simulate episodes into the columns from `row` on. Returns the number of clipped actions."""
    chunk = min(CHUNK, run.world.steps)
    record = np.empty((len(places.rows), chunk + 1, run.n))
    actions = np.empty((chunk, run.n, 3), dtype=np.float32)
    log_prob = np.empty((chunk, run.n))
    total = 0
    for t, count, clipped in run.play(record, places.rows, actions, log_prob):
        total += clipped
        kernel.scatter_columns(
            record, actions, log_prob, places.sources, places.first_action, places.log_prob,
            table, row + t, count, run.world.steps,
        )  # fmt: skip
    return total
