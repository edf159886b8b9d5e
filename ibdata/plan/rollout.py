"""Simulate episodes of an experiment into columns, and ask its policies again about recorded episodes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ibdata._numerics.arrays import Float32s, Floats, Ints
from ibdata._numerics.random import Purpose, stream_key
from ibdata._simulation import kernel
from ibdata._simulation.carry import begin
from ibdata._simulation.episodes import Episodes, FloatTable, draw_uniforms
from ibdata._simulation.replay import replay
from ibdata._simulation.unroll import LANES, Block, unroll
from ibdata._system.progress import Advance, unseen
from ibdata.experiment.models import Experiment
from ibdata.plan.columns import Layout, layout
from ibdata.policies import OBSERVATION
from ibdata.policies.compound import PolicyMixture
from ibdata.policies.distributions import Distribution, applied

LEAST_LANES = 64
# Rows of a table. One table is encoded while the next is filled.
# The last bits of the statistics depend on this number.
PART_ROWS = 2**18


class FilledColumns(NamedTuple):
    """The float columns of some episodes, rows ordered by (episode, step)."""

    names: tuple[str, ...]
    table: FloatTable  # (columns, rows)
    clipped: int  # number of actions that were clipped


class TableBuffer:
    """The memory of one table. All calls of `rollout` in a thread share it."""

    _bytes = np.empty(0, np.uint8)

    def table(self, shape: tuple[int, int], dtype: str) -> FloatTable:
        """A table of any content. It replaces the previous table."""
        size = shape[0] * shape[1] * np.dtype(dtype).itemsize
        if size > len(self._bytes):
            self._bytes = np.empty(size, np.uint8)
        return self._bytes[:size].view(dtype).reshape(shape)


def rollout(
    experiment: Experiment,
    first: int,
    stop: int,
    memory: TableBuffer | None = None,
    advance: Advance = unseen,
) -> FilledColumns:
    """Simulate episodes first … stop - 1 of a dataset into a table in the given memory.

    `advance` is called after some steps of some episodes with their rows.

    Raises PolicyError for an action that is not valid. It names policy, episode and step.
    """
    float_layout, steps = layout(experiment), experiment.steps
    shape = (len(float_layout.names), (stop - first) * steps)
    table = (memory or TableBuffer()).table(shape, experiment.output.dtype)
    clipped = 0
    for start, end in blocks(experiment, first, stop):
        episodes = episodes_of(experiment, np.arange(start, end))
        for block in unroll(episodes, begin(episodes), float_layout.rows, steps, densities=True):
            write_columns(block, float_layout, table, (start - first) * steps, steps)
            clipped += block.clipped
            advance((end - start) * len(block.actions))
    if experiment.output.expert_action:
        rows = table.reshape(len(table), stop - first, steps).transpose(1, 2, 0)
        acted = rows[..., float_layout.first_action :][..., :3]
        answers = expert_actions(experiment, first, stop, rows[..., : len(OBSERVATION)], acted)
        own = [i for i, name in enumerate(float_layout.names) if name.startswith("expert_act_")]
        table[own] = answers.reshape(-1, 3).T
    return FilledColumns(float_layout.names, table, clipped)


def expert_actions(
    experiment: Experiment, first: int, stop: int, observations: FloatTable, actions: FloatTable
) -> Float32s:
    """The actions (n, steps, 3) that the expert would take in the rows of episodes first … stop - 1.

    It watches the recorded observations (n, steps, 6) and actions (n, steps, 3) up to each row.
    """

    def action(distribution: Distribution) -> tuple[Float32s]:
        return (applied(distribution.sample(np.empty((0, 0)))),)  # it draws nothing

    expert = experiment.scenario.expert
    episodes = episodes_of(experiment, np.arange(first, stop)).played_by(expert)
    [answers] = replay(episodes, observations.astype(np.float32), actions.astype(np.float32), action)
    return answers


def parts(experiment: Experiment, first: int, stop: int) -> Iterator[tuple[int, int]]:
    """Split episodes first … stop - 1 into parts, each of which is simulated into one table.

    A part consists of whole blocks and has at most PART_ROWS rows. If not even one block fits, a part has as
    many episodes as fit, but at least LEAST_LANES, because fewer lanes are simulated slowly.
    """
    fitting = PART_ROWS // experiment.steps
    episodes = fitting // LANES * LANES or max(fitting, LEAST_LANES)
    for start in range(first, stop, episodes):
        yield start, min(stop, start + episodes)


def blocks(experiment: Experiment, first: int, stop: int) -> Iterator[tuple[int, int]]:
    """Split episodes first … stop - 1 into blocks of at most LANES episodes with the same policy."""
    per_policy = experiment.episodes_per_policy
    while first < stop:
        end = min(stop, first + LANES, (first // per_policy + 1) * per_policy)
        yield first, end
        first = end


def episodes_of(experiment: Experiment, numbers: Ints) -> Episodes:
    """The episodes with these numbers (n,). All of them get the policy of the first one."""
    cell_numbers, indices = np.divmod(numbers, experiment.episodes)
    distinct, cell_indices = np.unique(cell_numbers, return_inverse=True)
    cells = [experiment.cells[i] for i in distinct.tolist()]
    keys = np.array([stream_key(experiment.seed, cell.digest) for cell in cells])[cell_indices]
    setpoints = np.array([cell.setpoint for cell in cells])[cell_indices]
    return Episodes(
        experiment.scenario.world,
        cells[0].policy,
        cells[0].label,
        keys=keys,
        policy_keys=keys,
        index=indices,
        setpoint=setpoints,
        number=numbers,
    )


def write_columns(block: Block, float_layout: Layout, table: FloatTable, row: int, steps: int) -> None:
    """Write a block of episodes with so many steps into a table, from the row `row` on."""
    kernel.scatter_columns(
        block.record, block.actions, block.log_density,
        float_layout.sources, float_layout.first_action, float_layout.log_prob,
        table, row + block.first, len(block.actions), steps,
    )  # fmt: skip


def acting_in(experiment: Experiment, numbers: Ints) -> tuple[list[str], Ints]:
    """Names of policies, and for each of these episodes (n,) the index of the name of its acting policy.

    A mixture draws a policy for each episode, and that policy is the acting one.
    """
    names, policy_indices = list(experiment.labels), numbers // experiment.episodes_per_policy
    acting = policy_indices.copy()
    for i, policy in enumerate(experiment.policies):
        rows = np.flatnonzero(policy_indices == i)
        if isinstance(policy, PolicyMixture) and len(rows):
            episodes = episodes_of(experiment, numbers[rows])
            [u] = draw_uniforms(episodes.draw, episodes.lanes, Purpose.EPISODE_POLICY, 0, 1, 1)
            acting[rows] = len(names) + policy.member(u[:, 0])
            names += policy.members
    return names, acting


def log_densities(
    experiment: Experiment, first: int, stop: int, observations: Float32s, actions: Float32s
) -> Floats:
    """The log densities (n, steps) of the actions of episodes first … stop - 1, all of one policy.

    The recorded observations are (n, steps, 6), and the actions (n, steps, 3).
    """

    def log_density(distribution: Distribution, actions: Float32s) -> tuple[Floats]:
        return (distribution.log_density(actions),)

    episodes = episodes_of(experiment, np.arange(first, stop))
    [densities] = replay(episodes, observations, actions, log_density, actions)
    return densities
