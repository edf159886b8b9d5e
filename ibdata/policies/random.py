"""Uniform random exploration."""

from __future__ import annotations

from typing import ClassVar, Literal

from ibdata.policies.base import Decision, Needs, Observed, Policy
from ibdata.policies.distributions import Uniform


class Random(Policy):
    """Draws each number of the action uniformly from [-1, 1], the paper's random exploration.

    Source: Hein et al. 2017, section "Experimental Prototypes".
    """

    needs: ClassVar[Needs] = Needs(history=0, step_draws=3)

    kind: Literal["random"] = "random"

    def decide(self, observed: Observed) -> Decision:
        return Decision(Uniform(), observed.memory)
