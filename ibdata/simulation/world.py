"""The world of episodes: how they begin and advance, with random integers from any source."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.dynamics import State, Variant, initial_state
from ibdata.numerics.philox import Raw
from ibdata.numerics.random import Purpose, slots, uniforms
from ibdata.policies.actions import clip_and_round
from ibdata.simulation import kernel
from ibdata.simulation.noise import DRIFT_SLOTS, DYNAMICS_SLOTS

Floats = npt.NDArray[np.float64]
Float32s = npt.NDArray[np.float32]
Ints = npt.NDArray[np.int64]
# (lanes, purpose, step, steps, slots) -> the integers (steps, slots, lanes) of `steps` steps from `step` on.
# A lane is the number of one of the episodes that are simulated side by side.
Draw = Callable[[Ints, Purpose, int, int, int], Raw]
# "default": velocity, gain and shift 50 each; "uniform" on [0, 100]; or the fewest and the most random steps.
Start = str | tuple[int, int]

NO_RECORD = np.empty((0, 0, 0))
NO_DRIFT = np.empty((0, DRIFT_SLOTS, 0), dtype=np.uint64)
NO_ROWS = np.empty(0, dtype=np.int64)


class Past(NamedTuple):
    """The latest observations of n lanes and the actions that led to them, newest first.

    Before the first observation of a lane, that one is repeated; before its first action, they are zero.
    """

    observations: Float32s  # (n, length, 6)
    actions: Float32s  # (n, length, 3), or (n, 0, 3) if nobody asks for them

    @classmethod
    def of(cls, state: State, length: int) -> Past:
        """The past at the first observation of every lane."""
        seen = (state.floats[:6].T + 0.0).astype(np.float32)
        return cls(
            np.repeat(seen[:, None], length, axis=1), np.zeros((len(seen), length, 3), dtype=np.float32)
        )

    def take(self, lanes: Ints) -> Past:
        """A copy of some lanes."""
        return Past(self.observations[lanes], self.actions[lanes])

    def put(self, lanes: Ints, part: Past) -> None:
        """Write some lanes."""
        self.observations[lanes], self.actions[lanes] = part


NO_PAST = Past(np.empty((0, 0, 6), dtype=np.float32), np.empty((0, 0, 3), dtype=np.float32))


@dataclasses.dataclass(frozen=True)
class World:
    """What episodes have in common.

    Random integers are drawn in a fixed order and only if they are used. So a `Draw` may compute them from
    their addresses, or take them from one generator per lane.
    """

    variant: Variant
    start: Start = "default"
    drifting: bool = False  # whether the setpoints move
    steps: int = 1000

    @cached_property
    def parameters(self) -> Floats:
        """The parameters of the dynamics, as the kernel takes them."""
        return self.variant.numbers

    def begin(self, draw: Draw, lanes: Ints, setpoints: Floats, history: int = 0) -> tuple[State, Past]:
        """The first recorded state of some lanes, and the past that a policy sees in it.

        It comes after the start, the zero-action step and the burn-in.
        """
        n = len(lanes)
        u = np.empty((n, 3))
        if self.start != "default":
            u = draw_uniforms(draw, lanes, Purpose.START, 0, 1, 3)[0]
        v, g, h = (100.0 * u if self.start == "uniform" else np.full((n, 3), 50.0)).T
        state = initial_state(setpoints, v, g, h, drifting=self.drifting)
        zeros = np.zeros((1, n, 3), dtype=np.float32)
        self.advance(state, zeros, *self.integers(draw, lanes, 0, 1))
        past = Past.of(state, history)
        if not isinstance(self.start, str):
            self._burn_in(state, past, burn_in_steps(*self.start, u), draw, lanes)
        return state, past

    def _burn_in(self, state: State, past: Past, counts: Ints, draw: Draw, lanes: Ints) -> None:
        """Advance each lane by counts (n,) steps with uniform random actions, in place."""
        for t in range(int(counts.max(initial=0))):
            running = np.flatnonzero(t < counts)
            some = lanes[running]
            raw, drift = self.integers(draw, some, t, 1, Purpose.BURN_IN_DYNAMICS, Purpose.BURN_IN_DRIFT)
            u = draw_uniforms(draw, some, Purpose.BURN_IN_POLICY, t, 1, 3)[0]
            action = np.empty((1, len(some), 3), dtype=np.float32)
            clip_and_round(2.0 * u - 1.0, action[0])
            part, seen = take(state, running), past.take(running)
            self.advance(part, action, raw, drift, seen)
            put(state, running, part)
            past.put(running, seen)

    def integers(
        self,
        draw: Draw,
        lanes: Ints,
        step: int,
        steps: int,
        dynamics: Purpose = Purpose.DYNAMICS,
        drift: Purpose = Purpose.DRIFT,
    ) -> tuple[Raw, Raw]:
        """Draw integers (steps, 8, lanes) for the dynamics, and (steps, 4, lanes) for moving setpoints.

        For constant setpoints the second array is empty.
        """
        raw = draw(lanes, dynamics, step, steps, DYNAMICS_SLOTS)
        if not self.drifting:
            return raw, NO_DRIFT
        return raw, draw(lanes, drift, step, steps, DRIFT_SLOTS)

    def advance(
        self,
        state: State,
        actions: Float32s,
        raw: Raw,
        drift: Raw,
        past: Past = NO_PAST,
        record: Floats = NO_RECORD,
        rows: Ints = NO_ROWS,
        first: int = 0,
    ) -> None:
        """Advance every lane by actions (steps, n, 3), in place; see `kernel.simulate` for the arguments."""
        kernel.simulate(*state, actions, raw, drift, self.parameters, *past, record, rows, first)


def burn_in_steps(fewest: int, most: int, u: Floats) -> Ints:
    """Numbers of steps (n,) of the burn-in, uniform on fewest … most, from the first column of u (n, 3).

    >>> burn_in_steps(15, 64, np.array([[0.0, 0, 0], [0.999, 0, 0]])).tolist()
    [15, 64]
    """
    return fewest + np.floor((most - fewest + 1) * u[:, 0]).astype(np.int64)


def draw_uniforms(draw: Draw, lanes: Ints, purpose: Purpose, step: int, steps: int, draws: int) -> Floats:
    """Draw numbers (steps, lanes, draws) from U(0, 1)."""
    u = np.empty((steps, len(lanes), draws))
    uniforms(draw(lanes, purpose, step, steps, slots(draws)), u)
    return u


def take(state: State, lanes: Ints) -> State:
    """A copy of some lanes."""
    return State(state.floats.take(lanes, axis=1), state.integers.take(lanes, axis=1))


def put(state: State, lanes: Ints, part: State) -> None:
    """Write some lanes back into a state."""
    state.floats[:, lanes] = part.floats
    state.integers[:, lanes] = part.integers
