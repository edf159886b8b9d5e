"""The base class of policies that let one of several others act."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from operator import itemgetter
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.policies.actions import applied
from ibdata.policies.base import Floats, Policy
from ibdata.policies.given import Decision, Given, Steps
from ibdata.policies.support import Support
from ibdata.policies.wrapper import part_of

Chosen = npt.NDArray[np.int64]


class Choice(Policy):
    """A policy that lets one of the policies of `inner` act in each episode at each step.

    The policies share memory and random numbers of a step, because only one of them acts; each has its own
    random numbers of an episode, which follow those of the choice itself.
    """

    @abstractmethod
    def chosen(self, given: Given) -> Chosen:
        """The number of the policy that acts in each episode, (n,)."""

    def began(self, given: Given) -> Steps:
        """The step of each episode at which the policy that acts began, without memory, (n,)."""
        return np.zeros_like(given.step)

    @property
    def own_uniforms_per_episode(self) -> int:
        """The number of random numbers of an episode that the choice itself uses."""
        return 0

    @property
    def history_length(self) -> int:  # type: ignore[override]  # read from instances only
        """As many observations as the policy sees that sees most."""
        return max(policy.history_length for policy in self.inner)

    @property
    def memory_size(self) -> int:  # type: ignore[override]  # read from instances only
        """As many numbers as the policy remembers that remembers most."""
        return max(policy.memory_size for policy in self.inner)

    @property
    def uniforms_per_step(self) -> int:  # type: ignore[override]  # read from instances only
        """As many numbers as the policy uses that uses most."""
        return max(policy.uniforms_per_step for policy in self.inner)

    @property
    def uniforms_per_episode(self) -> int:  # type: ignore[override]  # read from instances only
        """The random numbers of the choice and of all policies."""
        return self.own_uniforms_per_episode + sum(policy.uniforms_per_episode for policy in self.inner)

    def decide(self, given: Given) -> Decision:
        actions = np.empty((len(given.step), 3), dtype=np.float32)
        memory = np.zeros((len(given.step), self.memory_size))
        for policy, rows, part in self._parts(given):
            answer = policy.decide(part)
            actions[rows] = applied(answer.actions)
            memory[rows, : policy.memory_size] = answer.memory
        return Decision(actions, memory)

    def log_density(self, given: Given, action: npt.NDArray[np.float32]) -> Floats:
        """Return the log density (n,) of actions under the policies that act."""
        out = np.empty(len(action))
        for policy, rows, part in self._parts(given):
            out[rows] = policy.log_density(part, action[rows])
        return out

    def supports(self, step: int) -> tuple[Support, ...] | None:
        """Return the supports of all policies, of which any may act."""
        found = [policy.supports(step) for policy in self.inner]
        return None if None in found else tuple(support for each in found for support in each or ())

    def atoms(self, given: Given, action: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
        out = np.empty(action.shape, dtype=np.bool_)
        for policy, rows, part in self._parts(given):
            out[rows] = policy.atoms(part, action[rows])
        return out

    def _parts(self, given: Given) -> Iterator[tuple[Policy, npt.NDArray[np.intp], Given]]:
        """Yield each policy that acts in some episodes, the numbers of these, and what it is given."""
        which, step = self.chosen(given), given.step - self.began(given)
        memory = np.where(step[:, None] == 0, 0.0, given.memory)
        first = self.own_uniforms_per_episode
        for number, policy in enumerate(self.inner):
            rows = np.flatnonzero(which == number)
            if len(rows):
                own = given._replace(
                    step=step, memory=memory, episode_uniforms=given.episode_uniforms[:, first:]
                )
                some = own if len(rows) == len(step) else own.apply(itemgetter(rows))
                yield policy, rows, part_of(policy, some)
            first += policy.uniforms_per_episode


def forms(policies: tuple[Policy, ...]) -> list[dict[str, Any]]:
    """The forms of several policies, for the form of one that is made of them."""
    return [policy.form() for policy in policies]
