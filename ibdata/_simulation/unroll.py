"""Unroll episodes: at each step the policy is asked, and the state advances and is recorded.

Episodes are simulated side by side, which is faster than one by one; the values of one do not depend on the
others. They advance in blocks of steps: the integers are drawn, then each step is asked of the policy,
simulated and recorded.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ibdata._numerics.arrays import Float32s, Floats, Ints
from ibdata._numerics.random import Purpose
from ibdata._simulation.carry import Carry
from ibdata._simulation.episodes import Episodes, draw_uniforms
from ibdata.policies import Observed
from ibdata.policies.checked import act, ask, raise_placed
from ibdata.policies.distributions import read_only
from ibdata.policies.user_object import remembers

LANES = 256  # episodes that are simulated together, whose state and record stay in the processor's cache
BLOCK = 32  # steps that are drawn and recorded at a time, for the same reason


class Block(NamedTuple):
    """Some steps of n episodes. The next block overwrites its arrays."""

    first: int  # step
    record: Floats  # (variables, count + 1, n), from the state before the block to the state after it
    actions: Float32s  # (count, n, 3)
    log_density: Floats  # (count, n), of the policy's actions; 0 where it is not wanted
    clipped: int  # the number of the policy's actions that were clipped

    @property
    def stop(self) -> int:
        """The step after the last one."""
        return self.first + len(self.actions)


def unroll(
    episodes: Episodes,
    carry: Carry,
    rows: Ints,
    steps: int,
    *,
    recorded: Float32s | None = None,
    first_step: Ints | int = 0,
    stops: Iterable[int] = (),
    observe: Callable[[Observed], Observed] | None = None,
    densities: bool = False,
) -> Iterator[Block]:
    """Advance episodes by some steps.

    Args:
        episodes: the episodes.
        carry: where they are. It is advanced in place, so it says where they are after each block.
        rows: the variables to record, as rows of a state.
        steps: the number of steps.
        recorded: actions (k, n, 3) that are played at the first k steps. There a policy is asked only if it
            remembers something, so that its memory advances; its own actions are not played.
        first_step: the number (n,) of the step at which each episode goes on, which the policy is told.
        stops: steps at which a block ends.
        observe: changes what the policy is given, or None.
        densities: whether the log densities of the policy's actions are wanted, also where they are not
            played.

    Yields:
        Blocks of steps in order.

    Raises:
        PolicyError: the policy returned no valid action.
    """
    n, world = len(episodes), episodes.world
    recorded_steps, in_order = 0 if recorded is None else len(recorded), remembers(episodes.policy)
    # One time more than needed: no block is contiguous then, so code that takes one is compiled once.
    record = np.empty((len(rows), min(BLOCK, steps) + 2, n))
    actions, unplayed = np.empty((2, min(BLOCK, steps), n, 3), dtype=np.float32)
    log_density = np.zeros(actions.shape[:2])
    record[:, 0] = carry.state.values[rows] + 0.0
    for first, stop in pairwise(sorted({*range(0, steps, BLOCK), steps, *stops, min(recorded_steps, steps)})):
        count, clipped = stop - first, 0
        is_recorded = first < recorded_steps
        is_asked = not is_recorded or in_order
        together = count if not is_asked else asked_together(episodes, count)
        if recorded is not None and is_recorded:
            actions[:count] = recorded[first:stop]
        raw, drift = world.integers(episodes.draw, episodes.lanes, first + 1, count)
        questions = observed(episodes, carry, first, count, first_step)
        for t in range(0, count, together):
            part = slice(t, t + together)
            if is_asked:
                seen = next(questions) if observe is None else observe(next(questions))
                answers = (unplayed if is_recorded else actions)[part].reshape(-1, 3)
                density = log_density[part].reshape(-1) if densities else None
                try:
                    distribution, carry.memory = ask(episodes.policy, seen)
                    clipped += act(distribution, seen.draws, answers, density)
                except BaseException as error:
                    raise_placed(error, episodes.label, seen, episodes.number)
            carry.advance(world, actions[part], raw[part], drift[part], record, rows, 1 + t)
        yield Block(first, record[:, : count + 1], actions[:count], log_density[:count], clipped)
        record[:, 0] = record[:, count]


def observed(
    episodes: Episodes, carry: Carry, first: int, count: int, first_step: Ints | int = 0
) -> Iterator[Observed]:
    """Yield what the policy is given at some steps.

    A policy that sees and remembers nothing is asked about all steps at once, any other one step after
    another: what it sees and remembers is then that of the carry when it is asked.
    """
    n, needs, span = len(episodes), episodes.policy.needs, asked_together(episodes, count)
    u = draw_uniforms(episodes.draw, episodes.lanes, Purpose.POLICY, first, count, needs.draws)
    steps = np.empty((count, n), dtype=np.int64)
    steps[:] = np.arange(first, first + count)[:, None]
    steps += first_step
    of_episode = read_only(carry.episode_draws if span == 1 else np.tile(carry.episode_draws, (span, 1)))
    observations, actions = (
        read_only(x) if needs.history else np.empty((span * n, *x.shape[1:]), dtype=np.float32)
        for x in (carry.observations, carry.actions)
    )
    nothing = np.empty((span * n, 0))
    for t in range(0, count, span):
        memory = read_only(carry.memory) if needs.memory else nothing
        draws = u[t : t + span].reshape(span * n, -1)
        yield Observed(observations, actions, steps[t : t + span].reshape(-1), draws, of_episode, memory)


def asked_together(episodes: Episodes, count: int) -> int:
    """How many of some steps the policy is asked about at once."""
    needs = episodes.policy.needs
    return count if needs.history == needs.memory == 0 else 1
