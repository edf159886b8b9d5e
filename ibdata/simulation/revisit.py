"""Simulate episodes again with their recorded actions, which gives the exact states behind their rows."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.dynamics import State
from ibdata.experiment import Experiment
from ibdata.numerics.philox import Raw
from ibdata.numerics.random import stream_key
from ibdata.policies import Policy
from ibdata.policies.checked import CheckedPolicy
from ibdata.policies.given import Given
from ibdata.simulation import kernel
from ibdata.simulation.episodes import Float32s, Floats, Past, put, take
from ibdata.simulation.rollout import CHUNK, Block
from ibdata.simulation.variables import Table, layout
from ibdata.variables import FLOATS, INTEGERS

if TYPE_CHECKING:
    from typing_extensions import Self

Ints = npt.NDArray[np.int64]


def addressed(experiment: Experiment, numbers: Ints) -> tuple[Ints, Raw, Floats]:
    """The indices (n,) and keys (n, 2) of episodes (n,) of an experiment, and their setpoints (n,)."""
    cell_numbers, indices = np.divmod(numbers, experiment.episodes)
    cells = [experiment.cells[i] for i in cell_numbers.tolist()]
    keys = np.array([stream_key(experiment.seed, cell.digest) for cell in cells])
    return indices, keys, np.array([cell.setpoint for cell in cells])


class Visited(NamedTuple):
    """The beginnings of n rows: the states before their actions, and what a policy knows there."""

    state: State
    past: Past
    memory: Floats  # (n, memory_size)
    drawn: Floats  # (n, uniforms_per_episode)

    @classmethod
    def room(cls, n: int, policy: Policy) -> Visited:
        """Room for n rows."""
        length = policy.history_length
        return cls(
            State(np.empty((len(FLOATS), n)), np.empty((len(INTEGERS), n), dtype=np.int64)),
            Past(np.empty((n, length, 6), dtype=np.float32), np.empty((n, length, 3), dtype=np.float32)),
            np.empty((n, policy.memory_size)),
            np.empty((n, policy.uniforms_per_episode)),
        )

    def take(self, rows: Ints) -> Visited:
        """A copy of some rows."""
        past = Past._make(x[rows] for x in self.past)
        return Visited(take(self.state, rows), past, self.memory[rows], self.drawn[rows])

    def put(self, rows: Ints, part: Visited) -> None:
        """Write some rows."""
        put(self.state, rows, part.state)
        self.past.observations[rows] = part.past.observations
        self.past.actions[rows] = part.past.actions
        self.memory[rows], self.drawn[rows] = part.memory, part.drawn


class Watching(CheckedPolicy):
    """A policy that is asked about given episodes, which errors name by their numbers."""

    numbers: list[int]

    @classmethod
    def of(cls, policy: Policy, numbers: Ints) -> Self:
        """The policy, which is asked about episodes of these numbers (n,)."""
        watching = cls(policy, policy.label, 0, len(numbers))
        watching.numbers = numbers.tolist()
        return watching

    def _place(self, given: Given, row: int) -> str:
        number = self.numbers[row % len(self.numbers)]
        return f"policy {self.label}: from episode {number}: step {given.step[row]}"


class Revisit(Block):
    """Any episodes of an experiment, side by side. A policy watches them, but their actions are given."""

    def __init__(self, experiment: Experiment, numbers: Ints, watching: Watching) -> None:
        indices, keys, setpoints = addressed(experiment, numbers)
        self._address(experiment, watching, indices, keys, keys)
        self._begin(setpoints)

    def rows(self, actions: Float32s, lanes: Ints, steps: Ints) -> tuple[Visited, Table]:
        """Play the recorded actions.

        A policy with a memory is asked at every step, with the random numbers of the episode's own policy. So
        if it is that policy, it remembers what it remembered then.

        Args:
            actions: the first actions of the episodes (rows, m, 3).
            lanes: for each of n wanted rows, the place (n,) of its episode.
            steps: the steps (n,) of the wanted rows.

        Returns:
            The n wanted rows, and the columns of all rows, (columns, m · rows), in the order of `rollout`;
            the column of log densities is 0.
        """
        rows, places = len(actions), layout(self.experiment)
        wanted = Visited.room(len(steps), self.policy)
        table = np.empty((len(places.names), self.n * rows), dtype=self.experiment.output.dtype)
        record = np.empty((len(places.rows), CHUNK + 1, self.n), dtype=table.dtype)
        unknown, ignored = np.zeros((CHUNK, self.n)), np.empty((self.n, 3), dtype=np.float32)
        span = 1 if self.policy.memory_size else CHUNK
        for t, stop in pairwise(sorted({*steps.tolist(), *range(0, rows, span), rows})):
            here = np.flatnonzero(steps == t)
            wanted.put(here, Visited(self.state, self.past, self.memory, self.drawn).take(lanes[here]))
            if self.policy.memory_size:
                [given] = self.questions(t, 1, 1)
                _, self.memory = self.checked.decide(given, ignored)
            record[:, 0] = np.concatenate(self.state)[places.rows] + 0.0
            raw, drift = self.episodes.integers(self.draw, self.lanes, t + 1, stop - t)
            self.episodes.advance(self.state, actions[t:stop], raw, drift, self.past, record, places.rows, 1)
            kernel.scatter_columns(
                record, actions[t:stop], unknown, places.sources, places.first_action, places.log_prob,
                table, t, stop - t, rows,
            )  # fmt: skip
        return wanted, table
