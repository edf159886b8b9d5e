"""Several policies one after another in each episode."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from ibdata.policies.base import Floats, FrozenModel, Policy
from ibdata.policies.choice import Choice, Chosen, forms
from ibdata.policies.epsilon_greedy import Probability, log_replaced, replaced
from ibdata.policies.given import Decision, Given, Steps
from ibdata.policies.support import INSIDE, Support, each
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
    control through deep reinforcement learning. The density is that of the stage. With `epsilon` around a
    policy with `per_dimension: true`, it is too great where only some numbers of an action are those of the
    inner base; `importance` refuses such policies.
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
    def uniforms_per_step(self) -> int:  # type: ignore[override]  # read from instances only
        """Those of the bases and, if actions are replaced, four: one that decides, three for the action."""
        return super().uniforms_per_step + 4 * self.explores

    def chosen(self, given: Given) -> Chosen:
        return self._stage(given.step)

    def began(self, given: Given) -> Steps:
        return self._starts[self.chosen(given)]

    def decide(self, given: Given) -> Decision:
        answer = super().decide(given)
        if not self.explores:
            return answer
        own = np.ascontiguousarray(given.uniforms[:, -4:])
        return answer._replace(actions=replaced(np.asarray(answer.actions), own, self.epsilon(given)))

    def log_density(self, given: Given, action: npt.NDArray[np.float32]) -> Floats:
        """Return the log density (n,) of actions in the stage of each episode."""
        density = super().log_density(given, action)
        if not self.explores:
            return density
        mass = np.asarray(self.atoms(given, action).all(axis=1))
        return log_replaced(density, mass, action, self.epsilon(given))

    def supports(self, step: int) -> tuple[Support, ...] | None:
        now = np.array([step])
        stage, epsilon = int(self._stage(now)[0]), float(self._epsilon(now)[0])
        base = self.stages[stage].base.supports(step - int(self._starts[stage]))
        if base is None or epsilon == 0.0:
            return base
        return (each(INSIDE),) if epsilon == 1.0 else tuple(support | each(INSIDE) for support in base)

    def atoms(self, given: Given, action: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
        kept = super().atoms(given, action) & (self.epsilon(given) < 1.0)[:, None]
        return kept | Policy.atoms(self, given, action)

    def epsilon(self, given: Given) -> Floats:
        """The share ε of actions that are replaced at the step of each episode, (n,)."""
        return self._epsilon(given.step)

    def _epsilon(self, step: Steps) -> Floats:
        """The share ε at some steps, (n,)."""
        first, last = np.array([stage.epsilon or (0.0, 0.0) for stage in self.stages]).T
        lengths = np.array([max(2, stage.steps or 2) for stage in self.stages])
        which = self._stage(step)
        passed = np.minimum((step - self._starts[which]) / (lengths[which] - 1), 1.0)
        epsilon: Floats = first[which] + passed * (last[which] - first[which])
        return epsilon

    def form(self) -> dict[str, Any]:
        """The form of the policy, which contains those of the bases."""
        plain = super().form()
        stages = zip(plain["stages"], forms(self.inner), strict=True)
        return {**plain, "stages": [{**stage, "base": form} for stage, form in stages]}

    def _stage(self, step: Steps) -> Chosen:
        """The number of the stage at some steps, (n,)."""
        return np.searchsorted(self._starts[1:], step, side="right").astype(np.int64)

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
