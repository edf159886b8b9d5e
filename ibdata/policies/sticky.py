"""A base policy whose last action is repeated now and then."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from ibdata.policies.base import Decision, Needs, Observed
from ibdata.policies.distributions import Certain, Mixture
from ibdata.policies.epsilon_greedy import Probability
from ibdata.policies.wrapper import Unnamed, Wrapper

if TYPE_CHECKING:
    from ibdata.policies import AnyPolicy


class Sticky(Wrapper):
    """Repeats the last action with probability κ; else, and at the first step, the base acts.

    An action is held for 1/(1 - κ) steps on average. Source: Machado et al. 2018, Revisiting the Arcade
    Learning Environment, where sticky actions belong to the environment.
    """

    own_needs: ClassVar[Needs] = Needs(history=1, step_draws=1)

    kind: Literal["sticky"] = "sticky"
    base: Annotated[AnyPolicy, Unnamed] = Field(description="the policy whose actions are repeated")
    kappa: Probability = Field(description="probability of repeating the last action, in [0, 1]")

    def decide(self, observed: Observed) -> Decision:
        base, memory = self.base_distribution(observed)
        kappa = np.where(observed.step > 0, self.kappa, 0.0)  # at the first step there is nothing to repeat
        last = Certain(observed.actions[:, 0])
        return Decision(Mixture(kappa, base, last, first=self.base.needs.step_draws), memory)
