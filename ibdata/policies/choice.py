"""The base class of policies that let one of several others act."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from operator import itemgetter

import numpy as np
import numpy.typing as npt

from ibdata.policies.base import Decision, Needs, Observed, Policy, Steps
from ibdata.policies.checked import distribution_of
from ibdata.policies.distributions import ByRow, Rows

Chosen = npt.NDArray[np.int64]


class Choice(Policy):
    """A policy that lets one of the policies of `inner` act in each episode at each step.

    The policies share memory and random numbers of a step, because only one of them acts; each has its own
    random numbers of an episode, which follow those of the choice itself.
    """

    @abstractmethod
    def chosen(self, observed: Observed) -> Chosen:
        """The number of the policy that acts in each episode, (n,)."""

    def began(self, observed: Observed) -> Steps:
        """The step of each episode at which the policy that acts began, without memory, (n,)."""
        return np.zeros_like(observed.step)

    @property
    def own_needs(self) -> Needs:
        """What the choice itself needs."""
        return Needs(history=0)

    @property
    def needs(self) -> Needs:
        """As much as the policy needs that needs most, random numbers of an episode for each, and its own."""
        own, needs = self.own_needs, [policy.needs for policy in self.inner]
        return Needs(
            history=max(n.history for n in needs),
            step_draws=max(n.step_draws for n in needs) + own.step_draws,
            episode_draws=sum(n.episode_draws for n in needs) + own.episode_draws,
            memory=max(n.memory for n in needs),
        )

    def decide(self, observed: Observed) -> Decision:
        memory, groups = np.zeros((len(observed.step), self.needs.memory)), []
        for policy, episodes, part in self._parts(observed):
            distribution, remembered = distribution_of(policy, part)
            memory[episodes, : part.memory.shape[1]] = remembered
            groups.append(Rows(episodes, distribution, policy.needs.step_draws))
        return Decision(ByRow(groups, self.needs.step_draws), memory)

    def _parts(self, observed: Observed) -> Iterator[tuple[Policy, npt.NDArray[np.intp], Observed]]:
        """Yield each policy that acts in some episodes, the numbers of these, and what it is observed."""
        which, step = self.chosen(observed), observed.step - self.began(observed)
        own = observed._replace(step=step, memory=np.where(step[:, None] == 0, 0.0, observed.memory))
        first = self.own_needs.episode_draws
        for number, policy in enumerate(self.inner):
            needs, rows = policy.needs, np.flatnonzero(which == number)
            if len(rows):
                part = own._replace(episode_uniforms=observed.episode_uniforms[:, first:]).cut(needs)
                yield policy, rows, part if len(rows) == len(step) else part.apply(itemgetter(rows))
            first += needs.episode_draws
