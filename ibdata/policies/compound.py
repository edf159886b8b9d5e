"""Policies within others: their types; a base whose actions are replaced; and one of several that acts."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping
from functools import cached_property
from itertools import accumulate
from operator import itemgetter
from typing import Annotated, Any, ClassVar, Literal, Union

import numpy as np
from pydantic import AfterValidator, Field, GetCoreSchemaHandler, GetJsonSchemaHandler, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema
from pydantic_core.core_schema import no_info_before_validator_function

from ibdata._numerics.arguments import can_act
from ibdata._numerics.arrays import Float32s, Floats, Ints
from ibdata._numerics.naming import unequal
from ibdata.errors import Problems
from ibdata.policies.base import (
    FROM_FLOAT,
    Decision,
    Deterministic,
    FrozenModel,
    Needs,
    Observed,
    Policy,
    is_deterministic,
)
from ibdata.policies.checked import ask
from ibdata.policies.distributions import ByRow, Distribution, Group, applied
from ibdata.policies.replaced import OrUniform
from ibdata.policies.weights_file import shipped_names

# By kind, in alphabetical order: the package fills it when all its modules are imported.
POLICIES: dict[str, type[Policy]] = {}


class OneOf:
    """An annotation of a policy: a block of one of these kinds, its bare name, or an object that acts.

    It asks for the kinds when a block is checked for the first time. All policies are known by then.
    """

    def __init__(self, is_allowed: Callable[[type[Policy]], bool]) -> None:
        self._is_allowed = is_allowed

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        kinds = tuple(filter(self._is_allowed, POLICIES.values()))
        block = handler.generate_schema(Annotated[Union[kinds], Field(discriminator="kind")])  # noqa: UP007
        return no_info_before_validator_function(block_of, block)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        block = handler(schema)
        options = {kind: POLICIES[kind].model_fields.values() for kind in block["discriminator"]["mapping"]}
        complete = [kind for kind, fields in options.items() if not any(x.is_required() for x in fields)]
        networks = shipped_names() if "network" in options else []
        return {"anyOf": [{"enum": [*complete, *networks], "type": "string"}, block]}


def is_foreign(value: Any) -> bool:
    """Whether the class of a value is none of ibdata's policies."""
    return type(value) not in POLICIES.values()


def block_of(value: Any) -> Any:
    """The block of the name of a kind or a network, or of an object of Python's; anything else as it is."""
    if isinstance(value, str):
        return {"kind": "network", "file": value} if value in shipped_names() else {"kind": value}
    if isinstance(value, type):
        raise ValueError(f"found the class {value.__name__}, expected an object: {value.__name__}(…)")
    if can_act(value) and is_foreign(value):
        return {"kind": "live", "target": value}
    is_object = isinstance(value, Mapping) and value.get("kind") == "custom" and can_act(value.get("target"))
    return {**value, "kind": "live"} if is_object else value


AnyPolicy = Annotated[Policy, OneOf(lambda policy: True)]
DeterministicBase = Annotated[
    Policy, OneOf(lambda policy: issubclass(policy, Deterministic) or "deterministic" in policy.model_fields)
]


def _without_name(base: Policy) -> Policy:
    if base.name is not None:
        problem = f"found {base.name!r} in a base, expected the name beside the outer kind"
        raise Problems([(("name",), problem)])
    return base


def _certain(base: Policy) -> Policy:
    if not is_deterministic(base):
        raise ValueError(
            f"found {base.label} without deterministic: true, expected a policy that draws nothing; if it is "
            "one, write {kind: custom, target: …, deterministic: true}"
        )
    return base


# Of a base: that it has no name, and that its actions are certain.
Unnamed, DrawsNothing = AfterValidator(_without_name), AfterValidator(_certain)


class Wrapper(Policy):
    """A policy that changes the actions of another one, its `base`, and sees what the base sees.

    It needs what the base needs and `own_needs`. The base uses the first of the random numbers and of the
    memory, the policy itself those that follow, see `beyond_base`.
    """

    base: Policy

    @property
    def own_needs(self) -> Needs:
        """What it needs beyond the needs of its base; of the history, the least."""
        return Needs(history=0)

    @property
    def needs(self) -> Needs:
        """The needs of the base and its own."""
        base, further = self.base.needs, self.own_needs
        return Needs(
            max(base.history, further.history),
            base.draws + further.draws,
            base.episode_draws + further.episode_draws,
            base.memory + further.memory,
        )

    def beyond_base(self, observed: Observed) -> Observed:
        """The random numbers and the memory that the base does not use."""
        base = self.base.needs
        return observed._replace(
            draws=np.ascontiguousarray(observed.draws[:, base.draws :]),
            episode_draws=np.ascontiguousarray(observed.episode_draws[:, base.episode_draws :]),
            memory=np.ascontiguousarray(observed.memory[:, base.memory :]),
        )

    def base_distribution(self, observed: Observed) -> tuple[Distribution, Floats]:
        """The distribution of the base's action, and its memory."""
        return ask(self.base, observed.cut(self.base.needs))

    def base_action(self, observed: Observed) -> tuple[Float32s, Floats]:
        """The actions (n, 3) of a base that draws nothing, clipped and rounded, and its memory."""
        distribution, memory = self.base_distribution(observed)
        return applied(distribution.sample(observed.draws)), memory


SimplePolicy = Annotated[Policy, OneOf(lambda policy: not issubclass(policy, Wrapper | Choice))]
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

    own_needs: ClassVar[Needs] = Needs(history=0, draws=4)  # one that decides, three for the action

    kind: Literal["epsilon_greedy"] = "epsilon_greedy"
    base: Annotated[SimplePolicy, Unnamed] = Field(description="the policy whose actions are replaced")
    epsilon: Probability = Field(description="probability of a random action, in [0, 1]")

    def decide(self, observed: Observed) -> Decision:
        base, memory = self.base_distribution(observed)
        epsilon = np.full(len(observed.step), self.epsilon)
        return Decision(OrUniform(epsilon, base, first=self.base.needs.draws), memory)


class Choice(Policy):
    """A policy that lets one of the policies of `inner` act in each episode at each step.

    The policies share memory and random numbers of a step, because only one of them acts; each has its own
    random numbers of an episode, which follow those of the choice itself.
    """

    @abstractmethod
    def chosen(self, observed: Observed) -> Ints:
        """The number of the policy that acts in each episode, (n,)."""

    def began(self, observed: Observed) -> Ints:
        """The step of each episode at which the policy that acts began, without memory, (n,)."""
        return np.zeros_like(observed.step)

    @property
    def own_needs(self) -> Needs:
        """What the choice itself needs."""
        return Needs(history=0)

    @property
    def needs(self) -> Needs:
        """The most that one of the policies needs; of an episode's random numbers the sum; and its own."""
        choice, needs = self.own_needs, [policy.needs for policy in self.inner]
        return Needs(
            history=max(n.history for n in needs),
            draws=max(n.draws for n in needs) + choice.draws,
            episode_draws=sum(n.episode_draws for n in needs) + choice.episode_draws,
            memory=max(n.memory for n in needs),
        )

    def decide(self, observed: Observed) -> Decision:
        memory, groups = np.zeros((len(observed.step), self.needs.memory)), []
        which, step = self.chosen(observed), observed.step - self.began(observed)
        begun = observed._replace(step=step, memory=np.where(step[:, None] == 0, 0.0, observed.memory))
        first = self.own_needs.episode_draws
        for number, policy in enumerate(self.inner):
            needs, rows = policy.needs, np.flatnonzero(which == number)
            if len(rows):
                part = begun._replace(episode_draws=observed.episode_draws[:, first:]).cut(needs)
                part = part if len(rows) == len(step) else part.apply(itemgetter(rows))
                distribution, memory[rows, : needs.memory] = ask(policy, part)
                groups.append(Group(rows, distribution, needs.draws))
            first += needs.episode_draws
        return Decision(ByRow(groups, self.needs.draws), memory)


class PolicyMixture(Choice):
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
    weights: (
        Annotated[list[Annotated[float, Field(gt=0.0, le=1e9, strict=True)]], Field(min_length=1)] | None
    ) = Field(
        default=None, description="how often each is drawn, relative to the others; default: equally often"
    )

    @property
    def members(self) -> list[str]:
        """The kinds of the policies; of equal ones, the later get -2, -3, …"""
        return unequal([base.kind for base in self.bases])

    def member(self, u: Floats) -> Ints:
        """The numbers (n,) of the policies that are drawn for episodes by their first random numbers (n,)."""
        weights = self.weights or [1.0] * len(self.bases)
        total = math.fsum(weights)
        bounds = [part / total for part in accumulate(weights)][:-1]
        return np.searchsorted(bounds, u, side="right").astype(np.int64)

    def chosen(self, observed: Observed) -> Ints:
        return self.member(observed.episode_draws[:, 0])

    @model_validator(mode="after")
    def _check(self) -> PolicyMixture:
        if self.weights is not None and len(self.weights) != len(self.bases):
            expected = f"{len(self.bases)}, one for each base"
            raise Problems([(("weights",), f"found {len(self.weights)}, expected {expected}")])
        return self


Share = Annotated[list[Probability], Field(min_length=2, max_length=2)]


class Stage(FrozenModel):
    """A stage of a schedule."""

    base: Annotated[AnyPolicy, Unnamed] = Field(description="the policy that acts")
    steps: Annotated[int, Field(ge=1, lt=2**31, strict=True), FROM_FLOAT] | None = Field(
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
    def explores(self) -> bool:
        """Whether actions are replaced in any stage."""
        return any(stage.epsilon for stage in self.stages)

    @property
    def own_needs(self) -> Needs:
        """If actions are replaced, four draws: one that decides, three for the action."""
        return Needs(history=0, draws=4 * self.explores)

    def chosen(self, observed: Observed) -> Ints:
        return np.searchsorted(self._starts[1:], observed.step, side="right").astype(np.int64)

    def began(self, observed: Observed) -> Ints:
        return self._starts[self.chosen(observed)]

    def decide(self, observed: Observed) -> Decision:
        decision = super().decide(observed)
        if not self.explores:
            return decision
        stages: Any = decision.action
        first = self.needs.draws - self.own_needs.draws
        return decision._replace(action=OrUniform(self.epsilon(observed), stages, first))

    def epsilon(self, observed: Observed) -> Floats:
        """The share ε of actions that are replaced at the step of each episode, (n,)."""
        first, last = np.array([stage.epsilon or (0.0, 0.0) for stage in self.stages]).T
        lengths = np.array([max(2, stage.steps or 2) for stage in self.stages])
        stage = self.chosen(observed)
        passed = np.minimum((observed.step - self._starts[stage]) / (lengths[stage] - 1), 1.0)
        epsilon: Floats = first[stage] + passed * (last[stage] - first[stage])
        return epsilon

    @cached_property
    def _starts(self) -> Ints:
        """The first step of each stage."""
        lengths = [0, *(stage.steps or 0 for stage in self.stages[:-1])]
        return np.cumsum(np.array(lengths, dtype=np.int64))

    @model_validator(mode="after")
    def _check(self) -> Schedule:
        for i, stage in enumerate(self.stages):
            changes = stage.epsilon is not None and stage.epsilon[0] != stage.epsilon[1]
            if stage.steps is None and (i < len(self.stages) - 1 or changes):
                raise Problems([(("stages", i, "steps"), "found none, expected the number of its steps")])
        return self
