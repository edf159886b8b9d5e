"""The driver: lanes with a policy on their way through their episodes.

Episodes are simulated side by side as lanes, which is faster than one by one; the values of a lane do not
depend on the others. They advance in chunks of steps: the integers are drawn, then each step is asked of the
policy, simulated and recorded.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.dynamics import State
from ibdata.numerics.philox import Raw
from ibdata.numerics.random import Purpose, integers
from ibdata.policies import Needs, Observed, Policy
from ibdata.policies.checked import Checked
from ibdata.simulation.world import Float32s, Floats, Ints, Past, World, draw_uniforms, put, take
from ibdata.variables import FLOATS, INTEGERS

LANES = 256  # lanes that are simulated together, whose state and record stay in the processor's cache
CHUNK = 32  # steps drawn and recorded at a time, for the same reason


class Lanes(NamedTuple):
    """n episodes side by side: who acts in them, and the addresses of their random numbers."""

    policy: Policy
    keys: Raw  # (n, 2), of the environment's random numbers
    policy_keys: Raw  # (n, 2), of the policy's
    indices: Ints  # (n,), of the episodes within their cells
    setpoints: Floats  # (n,), at the start
    label: str  # of the policy, for messages
    numbers: Ints  # (n,), of the episodes, for messages

    def draw(self, lanes: Ints, purpose: Purpose, step: int, steps: int, slots: int) -> Raw:
        """The integers (steps, slots, lanes) at these addresses."""
        keys = self.policy_keys if purpose in (Purpose.POLICY, Purpose.EPISODE_POLICY) else self.keys
        return integers(keys[lanes], self.indices[lanes], purpose, step, steps, slots)


class Situation(NamedTuple):
    """Where n lanes are before an action: their state, and what a policy knows."""

    state: State
    past: Past
    memory: Floats  # (n, memory)
    draws: Floats  # (n, episode_draws)

    @classmethod
    def room(cls, n: int, needs: Needs) -> Situation:
        """Room for n lanes."""
        return cls(
            State(np.empty((len(FLOATS), n)), np.empty((len(INTEGERS), n), dtype=np.int64)),
            Past(
                np.empty((n, needs.history, 6), dtype=np.float32),
                np.empty((n, needs.history, 3), dtype=np.float32),
            ),
            np.empty((n, needs.memory)),
            np.empty((n, needs.episode_draws)),
        )

    def take(self, lanes: Ints) -> Situation:
        """A copy of some lanes."""
        return Situation(
            take(self.state, lanes), self.past.take(lanes), self.memory[lanes], self.draws[lanes]
        )

    def put(self, lanes: Ints, part: Situation) -> None:
        """Write some lanes."""
        put(self.state, lanes, part.state)
        self.past.put(lanes, part.past)
        self.memory[lanes], self.draws[lanes] = part.memory, part.draws


class Run:
    """Lanes on their way. What the policy remembers is part of the run, so it ends with the episodes.

    Args:
        world: what the episodes have in common.
        lanes: the episodes.
        begun: where they begin; by default at their start. It is advanced in place.
        first_steps: the steps (n,) that the policy is told first, where they do not begin at their start.
    """

    def __init__(
        self, world: World, lanes: Lanes, begun: Situation | None = None, first_steps: Ints | int = 0
    ) -> None:
        self.world, self.lanes, self.needs = world, lanes, lanes.policy.needs
        self.n, self.everyone = len(lanes.indices), np.arange(len(lanes.indices))
        self.asked = Checked(lanes.policy, lanes.label, lanes.numbers)
        self.first_steps = first_steps
        self.state, self.past, self.memory, self.draws = self._start() if begun is None else begun
        self.draws = read_only(self.draws)

    def _start(self) -> Situation:
        draw, needs = self.lanes.draw, self.needs
        state, past = self.world.begin(draw, self.everyone, self.lanes.setpoints, needs.history)
        draws = draw_uniforms(draw, self.everyone, Purpose.EPISODE_POLICY, 0, 1, needs.episode_draws)[0]
        return Situation(state, past, np.zeros((self.n, needs.memory)), draws)

    @property
    def situation(self) -> Situation:
        """Where the lanes are now; not a copy."""
        return Situation(self.state, self.past, self.memory, self.draws)

    def play(
        self,
        record: Floats,
        rows: Ints,
        actions: Float32s,
        log_prob: Floats | None = None,
        observe: Callable[[Observed], Observed] | None = None,
        first_actions: Float32s | None = None,
    ) -> Iterator[tuple[int, int, int]]:
        """Play the episodes in chunks of steps, each of which overwrites the given arrays.

        Args:
            record: (variables, chunk + 1, n), from the state before a chunk to the state after it.
            rows: the variables to record, see `kernel.simulate`.
            actions: (chunk, n, 3).
            log_prob: (chunk, n), or None if no densities are wanted.
            observe: changes what the policy is given, or None.
            first_actions: the first actions (n, 3), or None if the policy chooses them.

        Yields:
            For each chunk its first step, its number of steps and its number of clipped actions.
        """
        chunk, steps = len(actions), self.world.steps
        record[:, 0] = np.concatenate(self.state)[rows] + 0.0
        for t in range(0, steps, chunk):
            count, clipped = min(chunk, steps - t), 0
            span = self._span(count)
            raw, drift = self.world.integers(self.lanes.draw, self.everyone, t + 1, count)
            for i, given in enumerate(self.questions(t, count)):
                part = slice(i * span, (i + 1) * span)
                chosen = actions[part].reshape(-1, 3)
                density = None if log_prob is None else log_prob[part].reshape(-1)
                seen = given if observe is None else observe(given)
                beyond, self.memory = self.asked.decide(seen, chosen, density)
                clipped += beyond
                if first_actions is not None and t + i == 0:
                    chosen[: self.n] = first_actions
                self.world.advance(
                    self.state, actions[part], raw[part], drift[part], self.past, record, rows, 1 + i * span
                )
            yield t, count, clipped
            record[:, 0] = record[:, count]

    def questions(self, t: int, count: int) -> Iterator[Observed]:
        """Yield what the policy is given at steps t … t + count - 1.

        A policy that sees and remembers nothing is asked about all steps at once, any other one step after
        another: past and memory are then those of the run when it is asked.
        """
        span = self._span(count)
        rows = span * self.n
        u = draw_uniforms(self.lanes.draw, self.everyone, Purpose.POLICY, t, count, self.needs.step_draws)
        steps = np.empty((count, self.n), dtype=np.int64)
        steps[:] = np.arange(t, t + count)[:, None]
        steps += self.first_steps
        draws = self.draws if span == 1 else np.tile(self.draws, (span, 1))
        seen, done = (
            read_only(x) if x.shape[1] else np.empty((rows, *x.shape[1:]), dtype=np.float32)
            for x in self.past
        )
        nothing = np.empty((rows, 0))
        for step, own in zip(steps.reshape(-1, rows), u.reshape(count // span, rows, -1), strict=True):
            memory = read_only(self.memory) if self.needs.memory else nothing
            yield Observed(seen, done, step, own, draws, memory)

    def _span(self, count: int) -> int:
        """How many of some steps the policy is asked about at once."""
        return count if self.needs.history == self.needs.memory == 0 else 1


def read_only(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """The same array, which cannot be changed through it."""
    view = array.view()
    view.flags.writeable = False
    return view
