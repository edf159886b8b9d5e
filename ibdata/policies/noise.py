"""A base policy with noise on its actions, or with actions that are held."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from ibdata.numerics.compiled import compiled
from ibdata.numerics.random import standard_normal
from ibdata.policies.base import Decision, Floats, Needs, Observed
from ibdata.policies.baselines import Constant
from ibdata.policies.compound import DrawsNothing, Probability, Unnamed, Wrapper
from ibdata.policies.distributions import Certain, ClippedNormal
from ibdata.policies.kinds import AnyPolicy, DeterministicBase
from ibdata.policies.replaced import OrCertain

# For less noise, float32 has too few actions: each is drawn again and again, so that no density is right.
Deviation = Annotated[float, Field(ge=1e-5, le=1e9, strict=True)]


class Gaussian(Wrapper):
    """Adds N(0, scale²) to each number of the base's action, and clips the sum to [-1, 1].

    The base must be deterministic, because a random base would give no simple density.
    """

    own_needs: ClassVar[Needs] = Needs(history=0, draws=3)

    kind: Literal["gaussian"] = "gaussian"
    base: Annotated[DeterministicBase, Unnamed, DrawsNothing] = Field(description="a deterministic policy")
    scale: Deviation = Field(description="standard deviation of the noise")

    def decide(self, observed: Observed) -> Decision:
        base, memory = self.base_action(observed)
        return Decision(ClippedNormal(base, self.scale), memory)


class OrnsteinUhlenbeck(Wrapper):
    """Adds an Ornstein-Uhlenbeck process to each number of the base's action, and clips the sum to [-1, 1].

        x[t] = (1 - θ) x[t-1] + σ z,    z ~ N(0, 1),    x before the first step is 0

    The process itself is not clipped; the density is conditional on it. Its standard deviation grows to
    σ / √(1 - (1 - θ)²), by default 0.38. Sources: Uhlenbeck and Ornstein 1930, On the theory of the Brownian
    motion; for exploration, with these defaults, Lillicrap et al. 2016 (arXiv 1509.02971), section 7.
    """

    own_needs: ClassVar[Needs] = Needs(history=0, draws=3, memory=3)  # the memory is x

    kind: Literal["ornstein_uhlenbeck"] = "ornstein_uhlenbeck"
    base: Annotated[DeterministicBase, Unnamed, DrawsNothing] = Field(
        default=Constant(), description="a deterministic policy; by default constant, with the action 0"
    )
    theta: Annotated[float, Field(ge=1e-9, le=1.0, strict=True)] = Field(
        default=0.15, description="share of the distance to 0 by which the process returns per step"
    )
    sigma: Deviation = Field(
        default=0.2, description="standard deviation of the random number added to the process per step"
    )

    def decide(self, observed: Observed) -> Decision:
        (base, memory), process = self.base_action(observed), self.beyond_base(observed)
        mean = base + (1.0 - self.theta) * process.memory
        x = _moved(process.memory, process.draws, self.theta, self.sigma)
        return Decision(ClippedNormal(mean, self.sigma), np.concatenate([memory, x], axis=1))


@compiled
def _moved(before: Floats, u: Floats, theta: float, sigma: float) -> Floats:
    x = np.empty((before.shape[0], 3))
    for i in range(x.shape[0]):
        for j in range(3):
            x[i, j] = (1.0 - theta) * before[i, j] + sigma * standard_normal(u[i, j])
    return x


class Sticky(Wrapper):
    """Repeats the last action with probability κ; else, and at the first step, the base acts.

    An action is held for 1/(1 - κ) steps on average. Source: Machado et al. 2018, Revisiting the Arcade
    Learning Environment, where sticky actions belong to the environment.
    """

    own_needs: ClassVar[Needs] = Needs(history=1, draws=1)

    kind: Literal["sticky"] = "sticky"
    base: Annotated[AnyPolicy, Unnamed] = Field(description="the policy whose actions are repeated")
    kappa: Probability = Field(description="probability of repeating the last action, in [0, 1]")

    def decide(self, observed: Observed) -> Decision:
        base, memory = self.base_distribution(observed)
        kappa = np.where(observed.step > 0, self.kappa, 0.0)  # at the first step there is nothing to repeat
        last = Certain(observed.actions[:, 0])
        return Decision(OrCertain(kappa, base, last, first=self.base.needs.draws), memory)
