"""Policies made of objects that are not ibdata's: with `decide`, `act` or `predict`, modules, functions."""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.policies.base import Floats, Policy
from ibdata.policies.conversation import Conversation
from ibdata.policies.given import Decision, Given
from ibdata.policies.support import Support
from ibdata.policies.ways import Way


class Adapter(Policy):
    """A policy made of an object that acts in one of five ways, of which the first that it has is used.

    - `act(history, u)`, as the short form of a `Policy` of ibdata;
    - `predict(observations)`, as in SB3 and d3rlpy;
    - `decide(given)`, as a `Policy` that may remember, which is asked in this way although it has `act` too;
    - a torch module, called on a float32 tensor of the observations, in evaluation mode without gradients;
    - any other callable, called on the observations like `predict`.

    Observations are float32 (n, 6 · history), newest first. The answer is (n, 3), or except from `act` a
    tuple that begins with it. The object may change the arrays that it is given, which are copies.

    `predict` gets each of these keywords that its signature has: `state`, which it returned after the actions
    at the step before, None at the first; `episode_start` (n,), true at the first step; and `deterministic`,
    true. A method `reset(n)` is called before the first step of n episodes that are simulated together. What
    an object remembers in another way, or draws itself, `Conversation` finds out.
    """

    @property
    @abstractmethod
    def adapted(self) -> Any:
        """The object."""

    @cached_property
    def way(self) -> Way:
        """The way in which the object acts."""
        return Way(self.adapted)

    @cached_property
    def conversation(self) -> Conversation:
        """What the object was asked, and its state."""
        return Conversation(self.way)

    @property
    def is_short(self) -> bool:
        """Whether the object has no way to remember anything."""
        return not (self.way.decides or self.way.may_remember)

    @property
    def memory_size(self) -> int:  # type: ignore[override]  # read from instances only
        """The object's own `memory_size` if it acts by `decide`, else 0."""
        return int(getattr(self.adapted, "memory_size", 0)) if self.way.decides else 0

    @property
    def uniforms_per_episode(self) -> int:  # type: ignore[override]  # read from instances only
        """The object's own `uniforms_per_episode` if it acts by `decide`, else 0."""
        return int(getattr(self.adapted, "uniforms_per_episode", 0)) if self.way.decides else 0

    def supports(self, step: int) -> tuple[Support, ...] | None:
        own = getattr(self.adapted, "support", None)
        return (own,) if isinstance(own, frozenset) else None

    def decide(self, given: Given) -> Decision:
        answer = self.conversation.answer(given)
        return Decision(answer.actions.copy(), answer.memory)

    def log_density(self, given: Given, action: npt.NDArray[np.float32]) -> Floats:
        own: Any = self.adapted
        if self.way.decides and hasattr(own, "log_density"):
            density: Floats = own.log_density(self.way.part(given).apply(np.copy), action.copy())
        elif hasattr(own, "log_prob"):
            density = own.log_prob(given.observations.copy(), action.copy())
        else:
            density = np.full(len(action), np.nan)
        return density
