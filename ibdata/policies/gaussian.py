"""A base policy with normal noise on its action."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from ibdata.policies.base import Decision, Needs, Observed
from ibdata.policies.distributions import ClippedNormal
from ibdata.policies.wrapper import Certain, Unnamed, Wrapper

if TYPE_CHECKING:
    from ibdata.policies import DeterministicBase


class Gaussian(Wrapper):
    """Adds N(0, scale²) to each number of the base's action, and clips the sum to [-1, 1].

    The base must be deterministic, because a random base would give no simple density.
    """

    own_needs: ClassVar[Needs] = Needs(history=0, step_draws=3)

    kind: Literal["gaussian"] = "gaussian"
    base: Annotated[DeterministicBase, Unnamed, Certain] = Field(description="a deterministic policy")
    scale: Annotated[float, Field(ge=1e-9, le=1e9, strict=True)] = Field(
        description="standard deviation of the noise"
    )

    def decide(self, observed: Observed) -> Decision:
        base, memory = self.base_action(observed)
        return Decision(ClippedNormal(base, self.scale), memory)
