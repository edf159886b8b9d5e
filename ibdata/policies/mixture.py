"""One of several policies, drawn for each episode."""

from __future__ import annotations

import math
from itertools import accumulate
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from ibdata.numerics.naming import unequal
from ibdata.policies.base import Floats, Needs, Observed, Policy
from ibdata.policies.choice import Choice, Chosen
from ibdata.policies.wrapper import Unnamed

if TYPE_CHECKING:
    from ibdata.policies import AnyPolicy

Weight = Annotated[float, Field(gt=0.0, le=1e9, strict=True)]


class Mixture(Choice):
    """Draws one of several policies for each episode; the drawn policy acts in it from start to end.

    `ds.episodes` names it in the column `acting`, unless the mixture is part of another policy. For exact
    shares, list policies beside one another instead: each gets the same number of episodes. The density is
    that of the policy that was drawn. Fu et al. 2020, D4RL (arXiv 2004.07219), make their medium-replay and
    medium-expert data of several policies.
    """

    own_needs: ClassVar[Needs] = Needs(history=0, episode_draws=1)

    kind: Literal["mixture"] = "mixture"
    bases: Annotated[list[Annotated[AnyPolicy, Unnamed]], Field(min_length=1, max_length=100)] = Field(
        description="the policies"
    )
    weights: Annotated[list[Weight], Field(min_length=1)] | None = Field(
        default=None,
        description="how often each is drawn, relative to the others; default: equally often",
    )

    @property
    def inner(self) -> tuple[Policy, ...]:
        """The policies."""
        return tuple(self.bases)

    @property
    def members(self) -> list[str]:
        """The kinds of the policies; of equal ones, the later get -2, -3, …"""
        return unequal([base.kind for base in self.bases])

    def member(self, u: Floats) -> Chosen:
        """The numbers (n,) of the policies that are drawn for episodes by their first random numbers (n,)."""
        weights = self.weights or [1.0] * len(self.bases)
        total = math.fsum(weights)
        bounds = [part / total for part in accumulate(weights)][:-1]
        return np.searchsorted(bounds, u, side="right").astype(np.int64)

    def chosen(self, given: Observed) -> Chosen:
        return self.member(given.episode_uniforms[:, 0])

    @model_validator(mode="after")
    def _check(self) -> Mixture:
        if self.weights is not None and len(self.weights) != len(self.bases):
            raise ValueError(
                f"found {len(self.weights)} weights, expected {len(self.bases)}, one for each of the bases"
            )
        return self
