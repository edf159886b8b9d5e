"""The question that a policy answers at every step, and its answer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

Float32s = npt.NDArray[np.float32]
Floats = npt.NDArray[np.float64]
Steps = npt.NDArray[np.int64]


class Given(NamedTuple):
    """Everything that the actions of n episodes at one step may depend on. The policy must not change it.

    Attributes:
        observations: the latest observations, float32 (n, history_length, 6), newest first, with the columns
            of `OBSERVATION`. Before an episode's first observation, that one is repeated.
        actions: the actions that led to these observations, float32 (n, history_length, 3), so the last
            action first. Before an episode's first action they are zero.
        step: the step of each episode, counted from 0, int64 (n,).
        uniforms: independent random numbers, uniform on (0, 1), float64 (n, uniforms_per_step).
        episode_uniforms: random numbers of the episode, which are the same at each of its steps, float64
            (n, uniforms_per_episode).
        memory: the numbers that the policy returned at the step before, float64 (n, memory_size); zeros at
            the start of an episode.
    """

    observations: Float32s
    actions: Float32s
    step: Steps
    uniforms: Floats
    episode_uniforms: Floats
    memory: Floats

    def apply(self, change: Callable[[Any], Any]) -> Given:
        """The same with each array changed, for instance cut to some of the episodes."""
        return Given._make(map(change, self))


class Decision(NamedTuple):
    """The actions of n episodes at one step.

    Attributes:
        actions: (Δvelocity, Δgain, Δshift) of each episode, (n, 3); the caller clips them to [-1, 1] and
            rounds them to float32.
        memory: the numbers that the policy will be given at the next step, float64 (n, memory_size).
    """

    actions: npt.ArrayLike
    memory: npt.ArrayLike


def at_start(observations: Float32s, uniforms: Floats) -> Given:
    """The first step of n episodes, for a policy without memory and without random numbers of the episode."""
    n, frames = observations.shape[:2]
    nothing = np.zeros((n, 0))
    actions = np.zeros((n, frames, 3), dtype=np.float32)
    return Given(observations, actions, np.zeros(n, dtype=np.int64), uniforms, nothing, nothing)
