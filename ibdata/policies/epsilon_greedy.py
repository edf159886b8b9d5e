"""A base policy whose action is replaced by a random one now and then."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, Field

from ibdata.policies.base import Decision, Needs, Observed
from ibdata.policies.distributions import Mixture, Uniform
from ibdata.policies.wrapper import Unnamed, Wrapper

if TYPE_CHECKING:
    from ibdata.policies import AnyBase

Probability = Annotated[
    float,
    Field(ge=0.0, le=1.0, strict=True, allow_inf_nan=False),
    AfterValidator(lambda value: value + 0.0),
]


class EpsilonGreedy(Wrapper):
    """Replaces the base's action with probability ε at each step by one drawn from U(-1, 1)³.

    The whole action is replaced. In `siemens-research/lion`, generate_data.py does so in its toy environment;
    we infer that the published Industrial Benchmark data were made in the same way.
    """

    own_needs: ClassVar[Needs] = Needs(history=0, step_draws=4)  # one that decides, three for the action

    kind: Literal["epsilon_greedy"] = "epsilon_greedy"
    base: Annotated[AnyBase, Unnamed] = Field(description="the policy whose actions are replaced")
    epsilon: Probability = Field(description="probability of a random action, in [0, 1]")

    def decide(self, observed: Observed) -> Decision:
        base, memory = self.base_distribution(observed)
        epsilon = np.full(len(observed.step), self.epsilon)
        return Decision(Mixture(epsilon, base, Uniform(), first=self.base.needs.step_draws), memory)
