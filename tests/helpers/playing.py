"""Policies alone, without an environment: they are given random observations and their own memory."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from ibdata.policies import Observed, Policy
from ibdata.policies.checked import distribution_of

Actions = npt.NDArray[np.float32]


def playing(policy: Policy, n: int, steps: int, seed: int = 0) -> Iterator[tuple[Observed, Actions]]:
    """Yield what a policy is given at each step of n episodes, and its actions as they are applied."""
    random, frames = np.random.default_rng(seed), policy.needs.history
    seen = random.uniform(0.0, 100.0, (n, frames, 6)).astype(np.float32)
    done, memory = np.zeros((n, frames, 3), dtype=np.float32), np.zeros((n, policy.needs.memory))
    drawn = random.random((n, policy.needs.episode_draws))
    for t in range(steps):
        u = random.random((n, policy.needs.step_draws))
        given = Observed(seen, done, np.full(n, t), u, drawn, memory)
        distribution, memory = distribution_of(policy, given)
        actions = np.clip(np.asarray(distribution.sample(u)), -1.0, 1.0).astype(np.float32)
        yield given, actions
        done = np.concatenate([actions[:, None], done], axis=1)[:, :frames]
        now = random.uniform(0.0, 100.0, (n, 1, 6)).astype(np.float32)
        seen = np.concatenate([now, seen], axis=1)[:, :frames]


def played(policy: Policy, n: int, steps: int, seed: int = 0) -> Actions:
    """The actions (n, steps, 3)."""
    return np.stack([actions for _, actions in playing(policy, n, steps, seed)], axis=1)
