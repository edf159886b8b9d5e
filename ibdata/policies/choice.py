"""The base class of policies that let one of several others act."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from operator import itemgetter

import numpy as np
import numpy.typing as npt

from ibdata.policies.actions import applied
from ibdata.policies.base import Bools, Decision, Float32s, Floats, Needs, Observed, Policy, Steps

Chosen = npt.NDArray[np.int64]


class Choice(Policy):
    """A policy that lets one of the policies of `inner` act in each episode at each step.

    The policies share memory and random numbers of a step, because only one of them acts; each has its own
    random numbers of an episode, which follow those of the choice itself.
    """

    @abstractmethod
    def chosen(self, given: Observed) -> Chosen:
        """The number of the policy that acts in each episode, (n,)."""

    def began(self, given: Observed) -> Steps:
        """The step of each episode at which the policy that acts began, without memory, (n,)."""
        return np.zeros_like(given.step)

    @property
    def own_needs(self) -> Needs:
        """What the choice itself needs."""
        return Needs(history=0)

    @property
    def needs(self) -> Needs:
        """As much as the policy needs that needs most, random numbers of an episode for each, and its own."""
        own, history, draws, episode_draws, memory = (
            self.own_needs,
            *zip(*(p.needs for p in self.inner), strict=True),
        )
        return Needs(
            max(history), max(draws) + own.step_draws, sum(episode_draws) + own.episode_draws, max(memory)
        )

    def decide(self, given: Observed) -> Decision:
        actions = np.empty((len(given.step), 3), dtype=np.float32)
        memory = np.zeros((len(given.step), self.needs.memory))
        for policy, rows, part in self._parts(given):
            decision = policy.decide(part)
            actions[rows] = applied(decision.actions)
            memory[rows, : part.memory.shape[1]] = decision.memory
        return Decision(actions, memory)

    def log_density(self, given: Observed, action: Float32s) -> Floats:
        """The log density (n,) under the policies that act."""
        out = np.empty(len(action))
        for policy, rows, part in self._parts(given):
            out[rows] = policy.log_density(part, action[rows])
        return out

    def atoms(self, given: Observed, action: Float32s) -> Bools:
        out = np.empty(action.shape, dtype=np.bool_)
        for policy, rows, part in self._parts(given):
            out[rows] = policy.atoms(part, action[rows])
        return out

    def _parts(self, given: Observed) -> Iterator[tuple[Policy, npt.NDArray[np.intp], Observed]]:
        """Yield each policy that acts in some episodes, the numbers of these, and what it is given."""
        which, step = self.chosen(given), given.step - self.began(given)
        own = given._replace(step=step, memory=np.where(step[:, None] == 0, 0.0, given.memory))
        first = self.own_needs.episode_draws
        for number, policy in enumerate(self.inner):
            needs, rows = policy.needs, np.flatnonzero(which == number)
            if len(rows):
                part = own._replace(episode_uniforms=given.episode_uniforms[:, first:]).cut(needs)
                yield policy, rows, part if len(rows) == len(step) else part.apply(itemgetter(rows))
            first += needs.episode_draws
