"""Ask a policy again about recorded episodes, under the actions that were taken there."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from ibdata.experiment.models import Experiment
from ibdata.experiment.rollout import blocks, lanes_of
from ibdata.policies import Observed
from ibdata.simulation.driver import CHUNK, Lanes, Run
from ibdata.simulation.world import Float32s, Floats, World

# Arrays (n, steps, …) of the episodes -> the rows (m, …) that a question is about.
Rows = Callable[[npt.NDArray[Any]], npt.NDArray[Any]]
Question = Callable[[Observed, Rows], npt.NDArray[Any]]


class Recorded(NamedTuple):
    """Recorded episodes."""

    observations: Float32s  # (n, steps, 6)
    actions: Float32s  # (n, steps, 3)


def log_densities(
    experiment: Experiment,
    first: int,
    stop: int,
    observations: Float32s,
    actions: Float32s,
) -> Floats:
    """The log densities (n, steps) of the actions of episodes first … stop - 1, all of one policy.

    The recorded observations are (n, steps, 6), and the actions (n, steps, 3).
    """
    out = np.empty(actions.shape[:2])
    for start, end in blocks(experiment, first, stop):  # so that memory is bounded
        own = slice(start - first, end - first)
        lanes = lanes_of(experiment, np.arange(start, end))
        recorded = Recorded(observations[own], actions[own])

        def density(given: Observed, rows: Rows, lanes: Lanes = lanes, own: Recorded = recorded) -> Floats:
            return lanes.policy.log_density(given, rows(own.actions))

        out[own] = replayed(experiment.world, lanes, recorded, density)
    return out


def replayed(world: World, lanes: Lanes, recorded: Recorded, question: Question) -> npt.NDArray[Any]:
    """The answers (n, steps, …) to a question about each row of recorded episodes.

    What a policy remembers is not recorded: it is computed again, step by step, from the observations, the
    actions and the random numbers at its addresses. Nothing is simulated but the burn-in. A policy that
    remembers nothing is asked about all steps at once, with random numbers that are 0.
    """
    run = Run(world, lanes)
    seen, done = _windows_of(run, recorded)
    n, steps = recorded.actions.shape[:2]
    if run.needs.memory == 0:

        def rows(x: npt.NDArray[Any]) -> npt.NDArray[Any]:
            return x.reshape(n * steps, *x.shape[2:])

        given = Observed(
            rows(seen),
            rows(done),
            np.tile(np.arange(steps), n),
            np.zeros((n * steps, run.needs.step_draws)),
            np.repeat(run.draws, steps, axis=0),
            np.zeros((n * steps, 0)),
        )
        found = question(given, rows)
        return found.reshape(n, steps, *found.shape[1:])
    answers = []
    for first in range(0, steps, CHUNK):
        for t, own in enumerate(run.questions(first, min(CHUNK, steps - first)), first):
            at_step = partial(_at_step, step=t)
            given = own._replace(observations=at_step(seen), actions=at_step(done))
            answers.append(question(given, at_step))
            run.memory = np.asarray(lanes.policy.decide(given).memory, dtype=np.float64)
    return np.stack(answers, axis=1)


def _at_step(x: npt.NDArray[Any], step: int) -> npt.NDArray[Any]:
    return np.ascontiguousarray(x[:, step])


def _windows_of(run: Run, recorded: Recorded) -> tuple[Float32s, Float32s]:
    """The observations (n, steps, history, 6) and actions (n, steps, history, 3) seen at each step."""
    observations, actions = recorded
    length = run.needs.history
    if length == 0:
        return observations[:, :, None][:, :, :0], actions[:, :, None][:, :, :0]
    return (
        _windows(run.past.observations[:, 1:], observations, length),
        _windows(run.past.actions, actions[:, :-1], length),
    )


def _windows(before: Float32s, recorded: Float32s, length: int) -> Float32s:
    """The last `length` rows before each step, newest first: (n, steps, length, c).

    Those that are recorded are (n, rows, c), and those before them, newest first, (n, k, c).
    """
    joined = np.concatenate([before[:, ::-1], recorded], axis=1)
    windows = sliding_window_view(joined, length, axis=1)  # (n, steps, c, length), oldest first
    return np.ascontiguousarray(np.moveaxis(windows, 2, 3)[:, :, ::-1])
