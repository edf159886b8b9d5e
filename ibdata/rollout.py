"""The pure function (experiment, episodes) → columns.

Episodes run side by side as lanes of a block, so that the compiled step has work to do; what a lane holds
does not depend on its block. A block advances in chunks of steps: draw the integers, simulate into a
record, then turn the record (step, lane, variable) into columns (episode, step).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata import lanes
from ibdata.asking import Asked
from ibdata.columns import Layout, Table, layout
from ibdata.dynamics.state import State, initial_state
from ibdata.experiment import Experiment
from ibdata.experiment.cells import Cell
from ibdata.experiment.fields import BurnIn
from ibdata.noise import (
    DRIFT_SLOTS,
    DYNAMICS_SLOTS,
    Purpose,
    Raw,
    Source,
    blank_noise,
    slots,
    stream_key,
    uniforms,
)
from ibdata.starts import burn_in_steps, steerings

LANES = 256  # a block's state and record stay in the processor's cache
CHUNK = 256  # steps drawn and recorded at a time


class Columns(NamedTuple):
    """The float columns of some episodes, rows ordered by (episode, step)."""

    names: tuple[str, ...]
    table: Table  # (columns, rows)
    clipped: int  # actions with a component outside [-1, 1], which was clipped


def rollout(experiment: Experiment, first: int, stop: int) -> Columns:
    """The columns of episodes first … stop - 1 of the dataset.

    Raises PolicyError naming policy, episode and step where an action is not finite or of wrong shape.
    """
    *_, (columns, _) = filling(experiment, first, stop)
    return columns


def filling(experiment: Experiment, first: int, stop: int) -> Iterator[tuple[Columns, int]]:
    """The columns while they fill, and the rows from the beginning that are there, always whole episodes.

    Raises as `rollout`.
    """
    places = layout(experiment)
    table = np.empty((len(places.names), (stop - first) * experiment.steps), dtype=experiment.output.dtype)
    clipped = 0
    for start, end in blocks(experiment, first, stop):
        clipped += Block(experiment, start, end).fill(table, (start - first) * experiment.steps, places)
        yield Columns(places.names, table, clipped), (end - first) * experiment.steps


def blocks(experiment: Experiment, first: int, stop: int) -> Iterator[tuple[int, int]]:
    """Runs of at most LANES episodes that have one policy."""
    per_policy = experiment.episodes * (len(experiment.cells) // len(experiment.policies))
    while first < stop:
        end = min(stop, first + LANES, (first // per_policy + 1) * per_policy)
        yield first, end
        first = end


class Block:
    """Some episodes side by side: their random numbers, their state and what the policy has seen."""

    def __init__(self, experiment: Experiment, first: int, stop: int) -> None:
        self.experiment, self.first, self.n = experiment, first, stop - first
        cell_numbers, self.indices = np.divmod(np.arange(first, stop), experiment.episodes)
        numbers, lane_cells = np.unique(cell_numbers, return_inverse=True)
        cells = [experiment.cells[i] for i in numbers.tolist()]
        self.policy = cells[0].policy
        self.asked = Asked(self.policy, cells[0].label, first)
        self.keys, self.policy_keys = (
            np.array([stream_key(experiment.seed, digest) for digest in digests])[lane_cells]
            for digests in zip(*map(self._digests, cells), strict=True)
        )
        self.source = Source()
        self.noise = blank_noise(self.n)
        self.parameters = experiment.variant.parameters()
        self.state = self._start(np.array([cell.setpoint for cell in cells])[lane_cells])

    @staticmethod
    def _digests(cell: Cell) -> tuple[bytes, bytes]:
        """What the addresses of the environment's random numbers and of the policy's begin with."""
        return cell.digest, cell.digest

    def _raw(self, purpose: Purpose, step: int, steps: int, count: int) -> Raw:
        keys = self.policy_keys if purpose is Purpose.POLICY else self.keys
        return self.source.lanes(keys, self.indices, purpose, step, steps, count)

    def _dynamics_raw(self, dynamics: Purpose, drift: Purpose, step: int, steps: int) -> tuple[Raw, Raw]:
        """Integers for the dynamics and for the moving setpoint; of the latter no steps if it is constant."""
        drift_steps = steps if self.experiment.drifting else 0
        return (
            self._raw(dynamics, step, steps, DYNAMICS_SLOTS),
            self._raw(drift, step, drift_steps, DRIFT_SLOTS),
        )

    def _start(self, setpoints: npt.NDArray[np.float64]) -> State:
        """The state after the zero-action step (address 0) and, where asked for, the burn-in."""
        start = self.experiment.start
        u = np.empty((self.n, 3))
        uniforms(self._raw(Purpose.START, 0, 1, slots(3)), 0, u)
        state = initial_state(setpoints, *steerings(start, u), drifting=self.experiment.drifting)
        raw, drift = self._dynamics_raw(Purpose.DYNAMICS, Purpose.DRIFT, 0, 1)
        zeros = np.zeros((self.n, 3), dtype=np.float32)
        lanes.step_lanes(state, zeros, raw, drift, 0, self.noise, self.parameters)
        if isinstance(start, BurnIn):
            state = self._burn_in(state, burn_in_steps(start, u), start.burn_in[1])
        return state

    def _burn_in(self, state: State, counts: npt.NDArray[np.int64], most: int) -> State:
        """The state after counts (n,) steps with uniform random actions; lanes that are done stay."""
        action = np.empty((self.n, 3), dtype=np.float32)
        u = np.empty((self.n, 3))
        for t in range(most):
            raw, drift = self._dynamics_raw(Purpose.BURN_IN_DYNAMICS, Purpose.BURN_IN_DRIFT, t, 1)
            uniforms(self._raw(Purpose.BURN_IN_POLICY, t, 1, slots(3)), 0, u)
            lanes.to_action(2.0 * u - 1.0, action)
            moved = State._make(x.copy() for x in state)
            lanes.step_lanes(moved, action, raw, drift, 0, self.noise, self.parameters)
            running = t < counts
            state = State._make(
                np.where(running.reshape(-1, *(1,) * (x.ndim - 1)), y, x)
                for x, y in zip(state, moved, strict=True)
            )
        return state

    def fill(self, table: Table, row: int, places: Layout) -> int:
        """Simulate the episodes into the columns from `row` on; the number of clipped actions."""
        steps, clipped = self.experiment.steps, 0
        chunk = min(CHUNK, steps)
        record = np.empty((chunk + 1, self.n, len(places.recorded)), dtype=table.dtype)
        actions = np.empty((chunk, self.n, 3), dtype=np.float32)
        log_prob = np.empty((chunk, self.n))
        history = np.empty((self.n, self.policy.frames, 6), dtype=np.float32)
        lanes.observe(self.state, history, True)
        lanes.record_state(self.state, record[0], self.experiment.drifting)
        for t0 in range(0, steps, chunk):
            count = min(chunk, steps - t0)
            clipped += self._simulate(t0, count, history, record, actions, log_prob)
            lanes.assemble(
                record, actions, log_prob, places.now, places.after, places.first_action, places.log_prob,
                table, row + t0, count, steps,
            )  # fmt: skip
            record[0] = record[count]
        return clipped

    def _simulate(
        self,
        t0: int,
        count: int,
        history: npt.NDArray[np.float32],
        record: Table,
        actions: npt.NDArray[np.float32],
        log_prob: npt.NDArray[np.float64],
    ) -> int:
        """Steps t0 … t0 + count - 1 into the record; the dynamics' address t + 1 leads from t to t + 1."""
        seen = history.view()
        seen.flags.writeable = False
        u = np.empty((self.n, self.policy.draws))
        raw, drift = self._dynamics_raw(Purpose.DYNAMICS, Purpose.DRIFT, t0 + 1, count)
        policy_raw = self._raw(Purpose.POLICY, t0, count, slots(self.policy.draws))
        clipped = 0
        for t in range(count):
            uniforms(policy_raw, t, u)
            clipped += self.asked.act(seen, u, actions[t], t0 + t)
            log_prob[t] = self.asked.log_prob(seen, actions[t], t0 + t)
            lanes.advance_and_record(
                self.state, actions[t], raw, drift, t, self.noise, self.parameters,
                history, record[t + 1], self.experiment.drifting,
            )  # fmt: skip
        return clipped
