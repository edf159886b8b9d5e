"""Simulate episodes of an experiment into columns, as a pure function.

Episodes are simulated side by side as the lanes of a block, which is faster than one by one; the values of a
lane do not depend on its block. A block advances in chunks of steps: it draws the integers, simulates into a
record (variable, step, lane), and copies that into columns (episode, step).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.experiment import Experiment
from ibdata.experiment.cells import Cell
from ibdata.numerics.philox import Raw
from ibdata.numerics.random import Purpose, integers, stream_key
from ibdata.policies import Policy
from ibdata.policies.checked import CheckedPolicy
from ibdata.policies.given import Given
from ibdata.simulation import kernel
from ibdata.simulation.episodes import Episodes, Lanes, draw_uniforms
from ibdata.simulation.variables import Layout, Table, layout

LANES = 256  # episodes of a block, whose state and record stay in the processor's cache
CHUNK = 32  # steps drawn and recorded at a time, for the same reason
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
    """Simulate episodes first … stop - 1 of a dataset.

    Args:
        experiment: the experiment.
        first: the first episode.
        stop: the episode after the last.
        memory: for the table; by default its own.

    Returns:
        The float columns, whose rows are ordered by (episode, step).

    Raises:
        PolicyError: a policy returned no valid action; the message names policy, episode and step.
    """
    places = layout(experiment)
    shape = len(places.names), (stop - first) * experiment.steps
    table = (memory or Memory()).table(shape, experiment.output.dtype)
    clipped = 0
    for start, end in blocks(experiment, first, stop):
        clipped += Block(experiment, start, end).fill(table, (start - first) * experiment.steps, places)
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
    per_policy = experiment.episodes * (len(experiment.cells) // len(experiment.policies))
    while first < stop:
        end = min(stop, first + LANES, (first // per_policy + 1) * per_policy)
        yield first, end
        first = end


class Block:
    """Some episodes side by side: the addresses of their random numbers, their state and their policy.

    What the policy remembers is part of the block, so it ends with the episodes. The policy is that of the
    episodes, or another one in its place, with the same random numbers.
    """

    def __init__(self, experiment: Experiment, first: int, stop: int, policy: Policy | None = None) -> None:
        cell_numbers, indices = np.divmod(np.arange(first, stop), experiment.episodes)
        numbers, lane_cells = np.unique(cell_numbers, return_inverse=True)
        cells = [experiment.cells[i] for i in numbers.tolist()]
        acting, label = (policy, policy.label) if policy else (cells[0].policy, cells[0].label)
        checked = CheckedPolicy(acting, label, first, stop - first)
        keys, policy_keys = (
            np.array([stream_key(experiment.seed, digest) for digest in digests])[lane_cells]
            for digests in zip(*map(self._digests, cells), strict=True)
        )
        self._address(experiment, checked, indices, keys, policy_keys)
        self._begin(np.array([cell.setpoint for cell in cells])[lane_cells])

    def _address(
        self, experiment: Experiment, checked: CheckedPolicy, indices: Lanes, keys: Raw, policy_keys: Raw
    ) -> None:
        """Set what the episodes depend on: indices (n,), and keys (n, 2) of environment and policy."""
        self.experiment, self.checked, self.policy = experiment, checked, checked.policy
        self.n, self.lanes, self.indices = len(indices), np.arange(len(indices)), indices
        self.keys, self.policy_keys = keys, policy_keys
        self.episodes = Episodes.of(experiment.start, experiment.drifting, experiment.variant)

    def _begin(self, setpoints: npt.NDArray[np.float64]) -> None:
        """Begin the episodes at setpoints (n,)."""
        length = self.policy.history_length
        self.state, self.past = self.episodes.begin(self.draw, self.lanes, setpoints, length)
        self.memory = np.zeros((self.n, self.policy.memory_size))
        draws = self.policy.uniforms_per_episode
        drawn = draw_uniforms(self.draw, self.lanes, Purpose.EPISODE_POLICY, 0, 1, draws)[0]
        self.drawn = read_only(drawn)

    @staticmethod
    def _digests(cell: Cell) -> tuple[bytes, bytes]:
        """The digests in the addresses of the environment's and of the policy's random numbers."""
        return cell.digest, cell.digest

    def draw(self, lanes: Lanes, purpose: Purpose, step: int, steps: int, slots: int) -> Raw:
        """The integers (steps, slots, lanes) at these addresses."""
        keys = self.policy_keys if purpose in (Purpose.POLICY, Purpose.EPISODE_POLICY) else self.keys
        return integers(keys[lanes], self.indices[lanes], purpose, step, steps, slots)

    def fill(self, table: Table, row: int, layout: Layout) -> int:
        """Simulate the episodes into the columns from `row` on. Returns the number of clipped actions."""
        chunk = min(CHUNK, self.experiment.steps)
        record = np.empty((len(layout.rows), chunk + 1, self.n), dtype=table.dtype)
        actions = np.empty((chunk, self.n, 3), dtype=np.float32)
        log_prob = np.empty((chunk, self.n))
        total = 0
        for t, count, clipped in self.play(record, layout.rows, actions, log_prob):
            total += clipped
            kernel.scatter_columns(
                record, actions, log_prob, layout.sources, layout.first_action, layout.log_prob,
                table, row + t, count, self.experiment.steps,
            )  # fmt: skip
        return total

    def play(
        self,
        record: Table,
        rows: npt.NDArray[np.int64],
        actions: npt.NDArray[np.float32],
        log_prob: npt.NDArray[np.float64] | None = None,
    ) -> Iterator[tuple[int, int, int]]:
        """Play the episodes in chunks of steps, each of which overwrites the given arrays.

        Args:
            record: (variables, chunk + 1, n), from the state before a chunk to the state after it.
            rows: the variables to record, see `kernel.simulate`.
            actions: (chunk, n, 3).
            log_prob: (chunk, n), or None if no densities are wanted.

        Yields:
            For each chunk its first step, its number of steps and its number of clipped actions.
        """
        chunk, steps = len(actions), self.experiment.steps
        record[:, 0] = np.concatenate(self.state)[rows] + 0.0
        for t in range(0, steps, chunk):
            count = min(chunk, steps - t)
            yield t, count, self._advance(t, count, record, rows, actions, log_prob)
            record[:, 0] = record[:, count]

    def _advance(
        self,
        t: int,
        count: int,
        record: Table,
        rows: npt.NDArray[np.int64],
        actions: npt.NDArray[np.float32],
        log_prob: npt.NDArray[np.float64] | None,
    ) -> int:
        """Play `count` steps from t on. Returns the number of clipped actions.

        The dynamics use the random numbers of address t + 1 for the step from t to t + 1. A policy that sees
        and remembers nothing acts for all steps in one call, any other policy for one step at a time.
        """
        span = count if self.policy.history_length == self.policy.memory_size == 0 else 1
        raw, drift = self.episodes.integers(self.draw, self.lanes, t + 1, count)
        clipped = 0
        for i, given in enumerate(self.questions(t, count, span)):
            part = slice(i * span, (i + 1) * span)
            chosen = actions[part].reshape(-1, 3)
            if log_prob is None:
                beyond, self.memory = self.checked.decide(given, chosen)
            else:
                density = log_prob[part].reshape(-1)
                beyond, self.memory = self.checked.decide_with_density(given, chosen, density)
            clipped += beyond
            self.episodes.advance(
                self.state, actions[part], raw[part], drift[part], self.past, record, rows, 1 + i * span
            )
        return clipped

    def questions(self, t: int, count: int, span: int) -> Iterator[Given]:
        """Yield what the policy is given at steps t … t + count - 1, `span` steps at a time.

        Past and memory are those of the block when it is asked.
        """
        rows = span * self.n
        u = draw_uniforms(self.draw, self.lanes, Purpose.POLICY, t, count, self.policy.uniforms_per_step)
        uniforms = u.reshape(count // span, rows, -1)
        steps = np.empty((count, self.n), dtype=np.int64)
        steps[:] = np.arange(t, t + count)[:, None]
        drawn = self.drawn if span == 1 else np.tile(self.drawn, (span, 1))
        seen, done = (
            read_only(x) if x.shape[1] else np.empty((rows, *x.shape[1:]), dtype=np.float32)
            for x in self.past
        )
        nothing = np.empty((rows, 0))
        for step, own in zip(steps.reshape(count // span, rows), uniforms, strict=True):
            memory = read_only(self.memory) if self.policy.memory_size else nothing
            yield Given(seen, done, step, own, drawn, memory)


def read_only(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """The same array, which cannot be changed through it."""
    view = array.view()
    view.flags.writeable = False
    return view
