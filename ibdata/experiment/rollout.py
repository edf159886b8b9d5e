"""Simulate episodes of an experiment into columns, as a pure function."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ibdata.experiment.columns import Layout, layout
from ibdata.experiment.models import Experiment
from ibdata.experiment.scenario import Cell
from ibdata.numerics.random import Purpose, stream_key
from ibdata.policies.compound import PolicyMixture
from ibdata.simulation import kernel
from ibdata.simulation.carry import begin
from ibdata.simulation.episodes import Episodes, Ints, draw_uniforms
from ibdata.simulation.unroll import LANES, Block, unroll
from ibdata.simulation.variables import Table

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
    places, steps = layout(experiment), experiment.steps
    table = (memory or Memory()).table((len(places.names), (stop - first) * steps), experiment.output.dtype)
    clipped = 0
    for start, end in blocks(experiment, first, stop):
        episodes = episodes_of(experiment, np.arange(start, end))
        for block in unroll(episodes, begin(episodes), places.rows, steps, densities=True):
            write_columns(block, places, table, (start - first) * steps, steps)
            clipped += block.clipped
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


def episodes_of(experiment: Experiment, numbers: Ints) -> Episodes:
    """Episodes of these numbers (n,), with the policy of the first of them and at their own addresses."""
    cells, cell_of, indices = cells_of(experiment, numbers)
    keys = np.array([stream_key(experiment.seed, cell.digest) for cell in cells])[cell_of]
    setpoints = np.array([cell.setpoint for cell in cells])[cell_of]
    policy, label = cells[0].policy, cells[0].label
    return Episodes(experiment.scenario.world, policy, label, keys, keys, indices, setpoints, numbers)


def cells_of(experiment: Experiment, numbers: Ints) -> tuple[list[Cell], Ints, Ints]:
    """The cells of episodes of these numbers (n,), and for each its place among them and its index there."""
    cell_numbers, indices = np.divmod(numbers, experiment.episodes)
    distinct, cell_of = np.unique(cell_numbers, return_inverse=True)
    return [experiment.cells[i] for i in distinct.tolist()], cell_of, indices


def write_columns(block: Block, places: Layout, table: Table, row: int, steps: int) -> None:
    """Write a block of episodes of so many steps into a table, in which the first of them begins at `row`."""
    kernel.scatter_columns(
        block.record, block.actions, block.log_density, places.sources, places.first_action, places.log_prob,
        table, row + block.first, len(block.actions), steps,
    )  # fmt: skip


def acting_in(experiment: Experiment, numbers: Ints) -> tuple[list[str], Ints]:
    """Names of policies, and the place among them of that which acts in each of these episodes (n,).

    Of a mixture, it is the policy that is drawn for the episode.
    """
    names, policies = list(experiment.labels), numbers // _per_policy(experiment)
    acting = policies.copy()
    for number, policy in enumerate(experiment.policies):
        here = np.flatnonzero(policies == number)
        if isinstance(policy, PolicyMixture) and len(here):
            episodes = episodes_of(experiment, numbers[here])
            [u] = draw_uniforms(episodes.draw, episodes.lanes, Purpose.EPISODE_POLICY, 0, 1, 1)
            acting[here] = len(names) + policy.member(u[:, 0])
            names += policy.members
    return names, acting


def _per_policy(experiment: Experiment) -> int:
    return experiment.episodes * (len(experiment.cells) // len(experiment.policies))
