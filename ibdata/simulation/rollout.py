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

from ibdata.dynamics.state import State, initial_state
from ibdata.experiment import Experiment
from ibdata.experiment.cells import Cell
from ibdata.experiment.fields import BurnIn
from ibdata.experiment.start import burn_in_steps, steerings
from ibdata.numerics.philox import Raw
from ibdata.numerics.random import Purpose, integers, slots, stream_key, uniforms
from ibdata.policies.actions import clip_and_round
from ibdata.policies.checked import CheckedPolicy
from ibdata.simulation import kernel
from ibdata.simulation.noise import DRIFT_SLOTS, DYNAMICS_SLOTS, blank_noise
from ibdata.simulation.packed import Packed, packed
from ibdata.simulation.variables import Layout, Table, layout

LANES = 256  # a block's state and record stay in the processor's cache
CHUNK = 32  # steps drawn and recorded at a time, for the same reason
LEAST_LANES = 64
PART_ROWS = 2**18  # a table that is encoded while the next is filled; the last bits of statistics hang on it


class Columns(NamedTuple):
    """The float columns of some episodes, rows ordered by (episode, step)."""

    names: tuple[str, ...]
    table: Table  # (columns, rows)
    clipped: int  # actions with a component outside [-1, 1], which was clipped


def rollout(experiment: Experiment, first: int, stop: int) -> Columns:
    """The columns of episodes first … stop - 1 of the dataset.

    Raises PolicyError naming policy, episode and step where an action is not finite or of wrong shape.
    """
    places = layout(experiment)
    table = np.empty((len(places.names), (stop - first) * experiment.steps), dtype=experiment.output.dtype)
    clipped = 0
    for start, end in blocks(experiment, first, stop):
        clipped += Block(experiment, start, end).fill(table, (start - first) * experiment.steps, places)
    return Columns(places.names, table, clipped)


def parts(experiment: Experiment, first: int, stop: int) -> Iterator[tuple[int, int]]:
    """Runs of episodes that are simulated into one table: of about PART_ROWS rows, and whole blocks of them.

    Where episodes are long they are at least LEAST_LANES, so that few steps are taken for little.
    """
    most = PART_ROWS // experiment.steps
    most = most // LANES * LANES or max(most, LEAST_LANES)
    for start in range(first, stop, most):
        yield start, min(stop, start + most)


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
        self.asked = CheckedPolicy(self.policy, cells[0].label, first, self.n)
        self.keys, self.policy_keys = (
            np.array([stream_key(experiment.seed, digest) for digest in digests])[lane_cells]
            for digests in zip(*map(self._digests, cells), strict=True)
        )
        self.noise = blank_noise(self.n)
        self.parameters = experiment.variant.parameters()
        self.state = self._start(np.array([cell.setpoint for cell in cells])[lane_cells])

    @staticmethod
    def _digests(cell: Cell) -> tuple[bytes, bytes]:
        """What the addresses of the environment's random numbers and of the policy's begin with."""
        return cell.digest, cell.digest

    def _raw(self, purpose: Purpose, step: int, steps: int, count: int) -> Raw:
        keys = self.policy_keys if purpose is Purpose.POLICY else self.keys
        return integers(keys, self.indices, purpose, step, steps, count)

    def _uniforms(self, purpose: Purpose, step: int, steps: int, draws: int) -> npt.NDArray[np.float64]:
        """Draws (steps, n, draws) from U(0, 1)."""
        u = np.empty((steps, self.n, draws))
        uniforms(self._raw(purpose, step, steps, slots(draws)), u)
        return u

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
        u = self._uniforms(Purpose.START, 0, 1, 3)[0]
        state = initial_state(setpoints, *steerings(start, u), drifting=self.experiment.drifting)
        raw, drift = self._dynamics_raw(Purpose.DYNAMICS, Purpose.DRIFT, 0, 1)
        zeros = np.zeros((self.n, 3), dtype=np.float32)
        kernel.step_lanes(state, zeros, raw, drift, 0, self.noise, self.parameters)
        if isinstance(start, BurnIn):
            state = self._burn_in(state, burn_in_steps(start, u), start.burn_in[1])
        return state

    def _burn_in(self, state: State, counts: npt.NDArray[np.int64], most: int) -> State:
        """The state after counts (n,) steps with uniform random actions; lanes that are done stay."""
        action = np.empty((self.n, 3), dtype=np.float32)
        for t in range(most):
            raw, drift = self._dynamics_raw(Purpose.BURN_IN_DYNAMICS, Purpose.BURN_IN_DRIFT, t, 1)
            u = self._uniforms(Purpose.BURN_IN_POLICY, t, 1, 3)[0]
            clip_and_round(2.0 * u - 1.0, action)
            moved = State._make(x.copy() for x in state)
            kernel.step_lanes(moved, action, raw, drift, 0, self.noise, self.parameters)
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
        history = np.empty((self.n, self.policy.history_length, 6), dtype=np.float32)
        kernel.observe(self.state, history, True)
        kernel.record_state(self.state, record[0], self.experiment.drifting)
        state = packed(self.state)
        for t in range(0, steps, chunk):
            count = min(chunk, steps - t)
            clipped += self._simulate(state, t, history, record[1:], actions[:count], log_prob[:count])
            kernel.scatter_columns(
                record, actions, log_prob, places.at_t, places.at_t_plus_1, places.first_action,
                places.log_prob, table, row + t, count, steps,
            )  # fmt: skip
            record[0] = record[count]
        return clipped

    def _simulate(
        self,
        state: Packed,
        t: int,
        history: npt.NDArray[np.float32],
        record: Table,
        actions: npt.NDArray[np.float32],
        log_prob: npt.NDArray[np.float64],
    ) -> int:
        """The steps from t on into the record; the dynamics' address t + 1 leads from t to t + 1.

        One at a time, because the policy looks at each; all at once for a policy without eyes.
        """
        count, drifting = len(actions), self.experiment.drifting
        span = 1 if self.policy.history_length else count
        seen = history if self.policy.history_length else np.empty((count * self.n, 0, 6), dtype=np.float32)
        seen = seen.view()
        seen.flags.writeable = False
        raw, drift = self._dynamics_raw(Purpose.DYNAMICS, Purpose.DRIFT, t + 1, count)
        u = self._uniforms(Purpose.POLICY, t, count, self.policy.uniforms_per_step)
        clipped = 0
        for part in (slice(i, i + span) for i in range(0, count, span)):
            rows = actions[part].reshape(-1, 3)
            clipped += self.asked.act(seen, u[part].reshape(len(rows), -1), rows, t + part.start)
            log_prob[part].reshape(-1)[:] = self.asked.log_prob(seen, rows, t + part.start)
            kernel.simulate(
                state, actions[part], raw[part], drift[part], self.parameters, history, record[part], drifting
            )
        return clipped
