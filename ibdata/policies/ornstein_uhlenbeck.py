"""A base policy with noise that drifts back to zero."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from ibdata.numerics.compiled import compiled
from ibdata.numerics.random import standard_normal
from ibdata.policies.base import Decision, Floats, Needs, Observed
from ibdata.policies.constant import Constant
from ibdata.policies.distributions import ClippedNormal
from ibdata.policies.wrapper import Certain, Unnamed, Wrapper

if TYPE_CHECKING:
    from ibdata.policies import DeterministicBase


class OrnsteinUhlenbeck(Wrapper):
    """Adds an Ornstein-Uhlenbeck process to each number of the base's action, and clips the sum to [-1, 1].

        x[t] = (1 - θ) x[t-1] + σ z,    z ~ N(0, 1),    x before the first step is 0

    The process itself is not clipped; the density is conditional on it. Its standard deviation grows to
    σ / √(1 - (1 - θ)²), by default 0.38. Sources: Uhlenbeck and Ornstein 1930, On the theory of the Brownian
    motion; for exploration, with these defaults, Lillicrap et al. 2016 (arXiv 1509.02971), section 7.
    """

    own_needs: ClassVar[Needs] = Needs(history=0, step_draws=3, memory=3)  # the memory is x

    kind: Literal["ornstein_uhlenbeck"] = "ornstein_uhlenbeck"
    base: Annotated[DeterministicBase, Unnamed, Certain] = Field(
        default=Constant(), description="a deterministic policy; by default constant, with the action 0"
    )
    theta: Annotated[float, Field(ge=1e-9, le=1.0, strict=True)] = Field(
        default=0.15, description="share of the distance to 0 by which the process returns per step"
    )
    sigma: Annotated[float, Field(ge=1e-9, le=1e9, strict=True)] = Field(
        default=0.2, description="standard deviation of the random number added to the process per step"
    )

    def decide(self, observed: Observed) -> Decision:
        (base, memory), own = self.base_action(observed), self.own(observed)
        mean = base + (1.0 - self.theta) * own.memory
        x = _moved(own.memory, own.uniforms, self.theta, self.sigma)
        return Decision(ClippedNormal(mean, self.sigma), self.remembered(memory, x))


@compiled
def _moved(before: Floats, u: Floats, theta: float, sigma: float) -> Floats:
    x = np.empty((before.shape[0], 3))
    for i in range(x.shape[0]):
        for j in range(3):
            x[i, j] = (1.0 - theta) * before[i, j] + sigma * standard_normal(u[i, j])
    return x
