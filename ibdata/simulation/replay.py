"""Ask a policy again about recorded episodes, under the actions that were taken there."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from ibdata.policies import Observed
from ibdata.policies.checked import CheckedPolicy
from ibdata.policies.distributions import Distribution
from ibdata.simulation.carry import begin
from ibdata.simulation.episodes import Episodes, Float32s
from ibdata.simulation.unroll import BLOCK, observed

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
    remembers nothing is asked about all steps at once, with random numbers that are 0.

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
    carry, needs = begin(episodes), episodes.policy.needs
    policy = CheckedPolicy(episodes.policy, episodes.label, episodes.number)
    seen = actions_before = np.empty((*actions.shape[:2], 0, 6), dtype=np.float32)
    if needs.history:
        seen = _windows(carry.observations[:, 1:], observations, needs.history)
        actions_before = _windows(carry.actions, actions[:, :-1], needs.history)
    n, steps = actions.shape[:2]
    if needs.memory == 0:
        everything = Observed(
            _rows(seen),
            _rows(actions_before),
            np.tile(np.arange(steps), n),
            np.zeros((n * steps, needs.step_draws)),
            np.repeat(carry.draws, steps, axis=0),
            np.zeros((n * steps, 0)),
        )
        of_rows = [_rows(array) for array in arrays]
        answers, _ = policy.ask(everything, partial(_ask, question=question, arrays=of_rows))
        return tuple(answer.reshape(n, steps, *answer.shape[1:]) for answer in answers)
    of_steps = []
    for first in range(0, steps, BLOCK):
        for t, simulated in enumerate(observed(episodes, carry, first, min(BLOCK, steps - first)), first):
            recorded = simulated._replace(observations=_at_step(seen, t), actions=_at_step(actions_before, t))
            of_step = [_at_step(array, t) for array in arrays]
            asked = partial(_ask, question=question, arrays=of_step)
            answers, carry.memory = policy.ask(recorded, asked)
            of_steps.append(answers)
    return tuple(np.stack(answers, axis=1) for answers in zip(*of_steps, strict=True))


def _ask(
    distribution: Distribution, question: Question, arrays: list[npt.NDArray[Any]]
) -> tuple[npt.NDArray[Any], ...]:
    return question(distribution, *arrays)


def _rows(x: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """An array (n, steps, …) as (n · steps, …)."""
    return x.reshape(x.shape[0] * x.shape[1], *x.shape[2:])


def _at_step(x: npt.NDArray[Any], step: int) -> npt.NDArray[Any]:
    return np.ascontiguousarray(x[:, step])


def _windows(before: Float32s, recorded: Float32s, length: int) -> Float32s:
    """The last `length` rows before each step, newest first: (n, steps, length, c).

    Those that are recorded are (n, rows, c), and those before them, newest first, (n, k, c).
    """
    joined = np.concatenate([before[:, ::-1], recorded], axis=1)
    windows = sliding_window_view(joined, length, axis=1)  # (n, steps, c, length), oldest first
    return np.ascontiguousarray(np.moveaxis(windows, 2, 3)[:, :, ::-1])
