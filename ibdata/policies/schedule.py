"""Several policies one after another in each episode."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from ibdata.policies.base import Decision, Floats, FrozenModel, Needs, Observed, Policy, Steps
from ibdata.policies.choice import Choice, Chosen
from ibdata.policies.distributions import Mixture, Uniform
from ibdata.policies.epsilon_greedy import Probability
from ibdata.policies.wrapper import Unnamed

if TYPE_CHECKING:
    from ibdata.policies import AnyPolicy

Share = Annotated[list[Probability], Field(min_length=2, max_length=2)]


class Stage(FrozenModel):
    """A stage of a schedule."""

    base: Annotated[AnyPolicy, Unnamed] = Field(description="the policy that acts")
    steps: Annotated[int, Field(ge=1, lt=2**31, strict=True)] | None = Field(
        default=None, description="length of the stage; the last one always lasts to the end of the episode"
    )
    epsilon: Share | None = Field(
        default=None,
        description="[first, last] share of actions that are replaced by random ones, at the first and the "
        "last step; between them it changes linearly",
    )


class Schedule(Choice):
    """Lets several policies act one after another in each episode, with more or fewer random actions.

    Each policy begins its stage as if it began an episode, with step 0 and without memory, but sees the
    observations and actions before. In a stage with `epsilon`, the whole action is replaced with probability
    ε by one drawn from U(-1, 1)³; ε changes linearly with the step, as in Mnih et al. 2015, Human-level
    control through deep reinforcement learning. The density is that of the stage.
    """

    kind: Literal["schedule"] = "schedule"
    stages: Annotated[list[Stage], Field(min_length=1, max_length=100)] = Field(
        description="the stages in order"
    )

    @property
    def inner(self) -> tuple[Policy, ...]:
        """The policies of the stages."""
        return tuple(stage.base for stage in self.stages)

    @property
    def explores(self) -> bool:
        """Whether actions are replaced in any stage."""
        return any(stage.epsilon for stage in self.stages)

    @property
    def own_needs(self) -> Needs:
        """If actions are replaced, four draws: one that decides, three for the action."""
        return Needs(history=0, step_draws=4 * self.explores)

    def chosen(self, observed: Observed) -> Chosen:
        return np.searchsorted(self._starts[1:], observed.step, side="right").astype(np.int64)

    def began(self, observed: Observed) -> Steps:
        return self._starts[self.chosen(observed)]

    def decide(self, observed: Observed) -> Decision:
        decision = super().decide(observed)
        if not self.explores:
            return decision
        stages: Any = decision.action
        first = self.needs.step_draws - self.own_needs.step_draws
        return decision._replace(action=Mixture(self.epsilon(observed), stages, Uniform(), first=first))

    def epsilon(self, observed: Observed) -> Floats:
        """The share ε of actions that are replaced at the step of each episode, (n,)."""
        first, last = np.array([stage.epsilon or (0.0, 0.0) for stage in self.stages]).T
        lengths = np.array([max(2, stage.steps or 2) for stage in self.stages])
        stage = self.chosen(observed)
        passed = np.minimum((observed.step - self._starts[stage]) / (lengths[stage] - 1), 1.0)
        epsilon: Floats = first[stage] + passed * (last[stage] - first[stage])
        return epsilon

    @cached_property
    def _starts(self) -> Steps:
        """The first step of each stage."""
        lengths = [0, *(stage.steps or 0 for stage in self.stages[:-1])]
        return np.cumsum(np.array(lengths, dtype=np.int64))

    @model_validator(mode="after")
    def _check(self) -> Schedule:
        for i, stage in enumerate(self.stages):
            changes = stage.epsilon is not None and stage.epsilon[0] != stage.epsilon[1]
            if stage.steps is None and (i < len(self.stages) - 1 or changes):
                raise ValueError(f"stages.{i}.steps: found none, expected the number of steps of this stage")
        return self
