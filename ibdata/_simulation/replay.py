"""Ask a policy again about recorded episodes, under the actions that were taken there."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from ibdata._numerics.arrays import Float32s, Floats
from ibdata._simulation.carry import begin
from ibdata._simulation.episodes import Episodes
from ibdata._simulation.unroll import BLOCK, observed
from ibdata.policies import Observed
from ibdata.policies.checked import ask, raise_placed
from ibdata.policies.user_object import remembers

FRAMES = 2**18  # frames that a policy sees at a time

# The distribution of the policy's actions in some rows, and arrays of these rows -> answers (rows, …).
Question = Callable[..., tuple[npt.NDArray[Any], ...]]


def replay(
    episodes: Episodes,
    observations: Float32s,
    actions: Float32s,
    question: Question,
    *arrays: npt.NDArray[Any],
) -> tuple[npt.NDArray[Any], ...]:
    """The answers to a question about a policy's distribution in each row of recorded episodes.

    What a policy remembers is not recorded: it is computed again, step by step, from the observations, the
    actions and the random numbers at its addresses. Nothing is simulated but the burn-in. A policy that
    remembers nothing is asked about many steps at once, with random numbers that are 0; about the fewer, the
    more frames it sees.

    Args:
        episodes: the episodes, and the policy that is asked.
        observations: the recorded observations (n, steps, 6).
        actions: the recorded actions (n, steps, 3).
        question: what is asked, see `Question`.
        arrays: further arguments of the question, (n, steps, …), of which it gets the rows it is about.

    Returns:
        The answers, (n, steps, …) each.

    Raises:
        PolicyError: the policy returned no valid decision.
    """
    most = FRAMES // max(1, episodes.policy.needs.history)  # episodes, and rows, at a time
    parts = []
    for first in range(0, len(episodes), most):
        lanes = episodes.lanes[first : first + most]
        recorded = (array[first : first + most] for array in (observations, actions, *arrays))
        parts.append(_replayed(episodes.take(lanes), question, most, *recorded))
    return tuple(map(np.concatenate, zip(*parts, strict=True)))


def _replayed(
    episodes: Episodes,
    question: Question,
    most: int,
    observations: Float32s,
    actions: Float32s,
    *arrays: npt.NDArray[Any],
) -> tuple[npt.NDArray[Any], ...]:
    """The answers for at most so many episodes, of which as many rows are asked about at a time."""
    carry, needs = begin(episodes), episodes.policy.needs
    seen = actions_before = np.empty((*actions.shape[:2], 0, 6), dtype=np.float32)
    if needs.history:
        seen = _windows(carry.observations[:, 1:], observations, needs.history)
        actions_before = _windows(carry.actions, actions[:, :-1], needs.history)
    n, steps = actions.shape[:2]
    answers: list[list[npt.NDArray[Any]]] = []

    def answer(given: Observed, first: int, stop: int) -> Floats:
        of_part = [_rows(array[:, first:stop]) for array in (seen, actions_before, *arrays)]
        recorded = given._replace(observations=of_part[0], actions=of_part[1])
        try:
            distribution, memory = ask(episodes.policy, recorded)
            found = question(distribution, *of_part[2:])
        except BaseException as error:
            raise_placed(error, episodes.label, recorded, episodes.number)
        answers.append([x.reshape(n, stop - first, *x.shape[1:]) for x in found])
        return memory

    if remembers(episodes.policy):
        for first in range(0, steps, BLOCK):
            for t, given in enumerate(observed(episodes, carry, first, min(BLOCK, steps - first)), first):
                carry.memory = answer(given, t, t + 1)
    else:
        for first in range(0, steps, most // n):
            stop = min(first + most // n, steps)
            rows = n * (stop - first)
            nothing = np.zeros((rows, 0))
            step, u = np.tile(np.arange(first, stop), n), np.zeros((rows, needs.draws))
            of_episode = np.repeat(carry.episode_draws, stop - first, axis=0)
            answer(Observed(nothing, nothing, step, u, of_episode, nothing), first, stop)
    return tuple(np.concatenate(blocks, axis=1) for blocks in zip(*answers, strict=True))


def _rows(x: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """An array (n, steps, …) as (n · steps, …)."""
    return np.ascontiguousarray(x.reshape(x.shape[0] * x.shape[1], *x.shape[2:]))


def _windows(before: Float32s, recorded: Float32s, length: int) -> Float32s:
    """The last `length` rows before each step, newest first: a view (n, steps, length, c).

    Those that are recorded are (n, rows, c), and those before them, newest first, (n, k, c).
    """
    joined = np.concatenate([before[:, ::-1], recorded], axis=1)
    windows = sliding_window_view(joined, length, axis=1)  # (n, steps, c, length), oldest first
    return np.moveaxis(windows, 2, 3)[:, :, ::-1]
