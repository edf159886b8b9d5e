"""Where episodes are: how they begin, and how they advance."""

from __future__ import annotations

import dataclasses

import numpy as np

from ibdata._numerics.arrays import Float32s, Floats, Ints
from ibdata._numerics.random import Purpose, Raw
from ibdata._simulation import kernel
from ibdata._simulation.episodes import Draw, Episodes, World, draw_uniforms, values_of
from ibdata.dynamics import State, initial_state
from ibdata.policies import Needs
from ibdata.policies.distributions import clip_and_round
from ibdata.views.options import BurnIn

NO_RECORD = np.empty((0, 0, 0))
NO_ROWS = np.empty(0, dtype=np.int64)


@dataclasses.dataclass(eq=False)
class Carry:
    """Where n episodes are: all that their next step needs.

    Observations and actions are the latest, newest first, those of the burn-in too. Before the first
    observation of all, that one is repeated; before the first action, they are zero.
    """

    state: State
    observations: Float32s  # (n, history, 6)
    actions: Float32s  # (n, history, 3): the actions that led to the observations; or none, (n, 0, 3)
    memory: Floats  # (n, memory), of the policy
    episode_draws: Floats  # (n, episode_draws), the policy's random numbers of the episode
    burn_in: BurnIn = ()  # of all lanes, where they begin; `take` and `put` leave it

    @classmethod
    def at(cls, state: State, needs: Needs) -> Carry:
        """The first observation of episodes in a state; the random numbers of the episode are zero."""
        n = state.lanes
        observation = (state.values[:6].T + 0.0).astype(np.float32)
        return cls(
            state,
            np.repeat(observation[:, None], needs.history, axis=1),
            np.zeros((n, needs.history, 3), dtype=np.float32),
            np.zeros((n, needs.memory)),
            np.zeros((n, needs.episode_draws)),
        )

    def take(self, lanes: Ints) -> Carry:
        """A copy of some episodes."""
        return Carry(
            self.state.take(lanes),
            self.observations[lanes],
            self.actions[lanes],
            self.memory[lanes],
            self.episode_draws[lanes],
        )

    def put(self, lanes: Ints, part: Carry) -> None:
        """Write some episodes."""
        self.state.put(lanes, part.state)
        self.observations[lanes], self.actions[lanes] = part.observations, part.actions
        self.memory[lanes], self.episode_draws[lanes] = part.memory, part.episode_draws

    def advance(
        self,
        world: World,
        actions: Float32s,
        raw: Raw,
        drift: Raw,
        record: Floats = NO_RECORD,
        rows: Ints = NO_ROWS,
        first: int = 0,
    ) -> None:
        """Advance every episode by actions (steps, n, 3), in place; see `kernel.simulate` for the arguments.

        Memory and random numbers of the episode stay: they are the policy's.
        """
        kernel.simulate(
            self.state.values, actions, raw, drift, world.parameters,
            self.observations, self.actions, record, rows, first,
        )  # fmt: skip


def begin(episodes: Episodes, rows: Ints = NO_ROWS) -> Carry:
    """Where episodes begin, with what their policy needs; for the rows see `begin_lanes`."""
    needs = episodes.policy.needs
    carry = begin_lanes(episodes.world, episodes.draw, episodes.lanes, episodes.setpoint, needs, rows)
    if needs.episode_draws:
        purpose, draws = Purpose.EPISODE_POLICY, needs.episode_draws
        [carry.episode_draws] = draw_uniforms(episodes.draw, episodes.lanes, purpose, 0, 1, draws)
    return carry


def begin_lanes(
    world: World, draw: Draw, lanes: Ints, setpoints: Floats, needs: Needs, rows: Ints = NO_ROWS
) -> Carry:
    """Where some lanes begin: after the start, the zero-action step and the burn-in.

    The steps of the burn-in have the values of these rows of a state, if there are any and a history is seen.
    Random integers are drawn in a fixed order and only if they are used. So a `Draw` may compute them from
    their addresses, or take them from one generator per lane.
    """
    n = len(lanes)
    u = np.empty((n, 3))
    if world.start != "default":
        [u] = draw_uniforms(draw, lanes, Purpose.START, 0, 1, 3)
    v, g, h = (100.0 * u if world.start == "uniform" else np.full((n, 3), 50.0)).T
    state = initial_state(setpoints, v, g, h, drifting=world.drifting)
    no_change = np.zeros((1, n, 3), dtype=np.float32)
    Carry.at(state, Needs(history=0)).advance(world, no_change, *world.integers(draw, lanes, 0, 1))
    carry = Carry.at(state, needs)
    if not isinstance(world.start, str):
        carry.burn_in = _burn_in(world, carry, burn_in_steps(*world.start, u), draw, lanes, rows)
    return carry


def _burn_in(world: World, carry: Carry, counts: Ints, draw: Draw, lanes: Ints, rows: Ints) -> BurnIn:
    """Advance each lane by counts (n,) steps with uniform random actions, in place."""
    steps, is_seen = [], len(rows) > 0 and carry.observations.shape[1] > 1
    for t in range(int(counts.max(initial=0))):
        running = np.flatnonzero(t < counts)
        some = lanes[running]
        noise = world.integers(draw, some, t, 1, Purpose.BURN_IN_DYNAMICS, Purpose.BURN_IN_DRIFT)
        [u] = draw_uniforms(draw, some, Purpose.BURN_IN_POLICY, t, 1, 3)
        actions = np.empty((1, len(some), 3), dtype=np.float32)
        clip_and_round(2.0 * u - 1.0, actions[0])
        part = carry.take(running)
        if is_seen:
            steps.append((running, values_of(part.state, rows), actions[0]))
        part.advance(world, actions, *noise)
        carry.put(running, part)
    return steps


def burn_in_steps(fewest: int, most: int, u: Floats) -> Ints:
    """Numbers of steps (n,) of the burn-in, uniform on fewest … most, from the first column of u (n, 3).

    >>> burn_in_steps(15, 64, np.array([[0.0, 0, 0], [0.999, 0, 0]])).tolist()
    [15, 64]
    """
    return fewest + np.floor((most - fewest + 1) * u[:, 0]).astype(np.int64)
