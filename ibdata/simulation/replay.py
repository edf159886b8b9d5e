"""The log densities of recorded actions, under the policy that took them or under another one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from ibdata.experiment import Experiment
from ibdata.numerics.random import Purpose
from ibdata.policies import Policy
from ibdata.policies.given import Given
from ibdata.simulation.episodes import Float32s, Floats, draw_uniforms
from ibdata.simulation.rollout import CHUNK, Block, blocks


def log_densities(
    experiment: Experiment,
    first: int,
    stop: int,
    observations: Float32s,
    actions: Float32s,
) -> Floats:
    """Compute the log densities of the actions of episodes first … stop - 1, all of one policy.

    What a policy remembers is not recorded: it is computed again, step by step, from the observations, the
    actions and the random numbers at their addresses. Nothing is simulated but the burn-in.

    Args:
        experiment: the experiment.
        first: the first episode.
        stop: the episode after the last.
        observations: the recorded observations, float32 (episodes, steps, 6).
        actions: the recorded actions, float32 (episodes, steps, 3).

    Returns:
        Log densities (episodes, steps).
    """
    out = np.empty(actions.shape[:2])
    for start, end in blocks(experiment, first, stop):  # so that memory is bounded
        own = slice(start - first, end - first)
        replay = _Replay(experiment, start, end)
        out[own] = replay.ask(replay.policy.log_density, observations[own], actions[own])
    return out


class Measured(NamedTuple):
    """Log densities (episodes, steps), and where their measure has unit masses (episodes, steps, 3)."""

    log_density: Floats
    atoms: npt.NDArray[np.bool_]


def measured(
    experiment: Experiment,
    first: int,
    stop: int,
    observations: Float32s,
    actions: Float32s,
    policy: Policy | None = None,
) -> Measured:
    """Compute the log densities of recorded actions with their measure; see `log_densities`.

    Args:
        experiment: as in `log_densities`.
        first: as in `log_densities`.
        stop: as in `log_densities`.
        observations: as in `log_densities`.
        actions: as in `log_densities`.
        policy: a policy in place of that of the episodes; it gets the same random numbers.

    Raises:
        PolicyError: the policy returned no valid density.
    """
    replay = _Replay(experiment, first, stop, policy)

    def question(given: Given, action: Float32s) -> Floats:
        return np.column_stack(
            [replay.checked.log_density(given, action), replay.policy.atoms(given, action)]
        )

    found = replay.ask(question, observations, actions)
    return Measured(found[..., 0], found[..., 1:] > 0.0)


class _Replay(Block):
    """Episodes whose actions are known."""

    def ask(
        self,
        question: Callable[[Given, Float32s], Floats],
        observations: Float32s,
        actions: Float32s,
    ) -> npt.NDArray[Any]:
        """The answers (n, steps, …) to a question about what is given and the actions."""
        seen, done = self._windows(observations, actions)
        if self.policy.memory_size == 0:
            return self._at_once(question, seen, done, actions)
        answers = []
        for t, u in self._uniforms(actions.shape[1]):
            before, chosen = np.ascontiguousarray(done[:, t]), np.ascontiguousarray(actions[:, t])
            now, step = np.ascontiguousarray(seen[:, t]), np.full(self.n, t)
            given = Given(now, before, step, u, self.drawn, self.memory)
            answers.append(question(given, chosen))
            self.memory = np.asarray(self.policy.decide(given).memory, dtype=np.float64)
        return np.stack(answers, axis=1)

    def _at_once(
        self, question: Callable[[Given, Float32s], Floats], seen: Float32s, done: Float32s, actions: Float32s
    ) -> npt.NDArray[Any]:
        """The answers for a policy that remembers nothing, which do not depend on the steps before."""
        n, steps = actions.shape[:2]
        given = Given(
            seen.reshape(n * steps, self.policy.history_length, 6),
            done.reshape(n * steps, self.policy.history_length, 3),
            np.tile(np.arange(steps), n),
            np.zeros((n * steps, self.policy.uniforms_per_step)),  # a density depends on no random number
            np.repeat(self.drawn, steps, axis=0),
            np.zeros((n * steps, 0)),
        )
        found = question(given, actions.reshape(n * steps, 3))
        return found.reshape(n, steps, *found.shape[1:])

    def _windows(self, observations: Float32s, actions: Float32s) -> tuple[Float32s, Float32s]:
        """The observations (n, steps, length, 6) and actions (n, steps, length, 3) seen at each step."""
        length = self.policy.history_length
        if length == 0:
            return observations[:, :, None][:, :, :0], actions[:, :, None][:, :, :0]
        return (
            _windows(self.past.observations[:, 1:], observations, length),
            _windows(self.past.actions, actions[:, :-1], length),
        )

    def _uniforms(self, steps: int) -> Iterator[tuple[int, Floats]]:
        """The steps and the policy's random numbers (n, uniforms_per_step) at each."""
        draws = self.policy.uniforms_per_step
        for t in range(0, steps, CHUNK):
            count = min(CHUNK, steps - t)
            u = draw_uniforms(self.draw, self.lanes, Purpose.POLICY, t, count, draws)
            yield from ((t + i, u[i]) for i in range(count))


def _windows(before: Float32s, recorded: Float32s, length: int) -> Float32s:
    """The last `length` rows before each step, newest first.

    Args:
        before: the rows before those that are recorded, newest first (n, k, c).
        recorded: (n, rows, c).
        length: the length of the history.

    Returns:
        (n, steps, length, c), for as many steps as there are whole windows.
    """
    joined = np.concatenate([before[:, ::-1], recorded], axis=1)
    windows = sliding_window_view(joined, length, axis=1)  # (n, steps, c, length), oldest first
    return np.ascontiguousarray(np.moveaxis(windows, 2, 3)[:, :, ::-1])
