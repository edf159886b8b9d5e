"""What a policy is: `decide` and `needs`, of an immutable block of options."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeGuard, TypeVar

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from ibdata._numerics.arrays import Float32s, Floats
from ibdata._numerics.naming import NAME_PATTERN
from ibdata.errors import excerpt
from ibdata.policies.distributions import Distribution

if TYPE_CHECKING:
    from typing_extensions import Self

    from ibdata.policies.code import Acting

Steps = npt.NDArray[np.int64]

Kind = TypeVar("Kind")
Name = Annotated[str, Field(pattern=NAME_PATTERN)]
# Of every whole number in a block, which is strict: 1e3 is one, true is none.
FROM_FLOAT = BeforeValidator(lambda x: int(x) if isinstance(x, float) and x.is_integer() else x)

# Columns of an observation vector, in the order of the published IB data.
OBSERVATION = ("setpoint", "velocity", "gain", "shift", "fatigue", "consumption")
SETPOINT, VELOCITY, GAIN, SHIFT, FATIGUE, CONSUMPTION = range(6)


class Needs(NamedTuple):
    """What a policy needs in order to act: how many numbers of each kind it is given.

    Attributes:
        history: the latest observations that it sees, 0 for none, and as many of the latest actions.
        draws: uniform random numbers at each step.
        episode_draws: uniform random numbers that are drawn once for an episode.
        memory: numbers that it remembers from one step to the next.
    """

    history: int = 1
    draws: int = 0
    episode_draws: int = 0
    memory: int = 0


class Observed(NamedTuple):
    """All that the actions of n episodes at one step may depend on. The policy must not change it.

    Attributes:
        observations: the latest observations, float32 (n, history, 6), newest first, with the columns of
            `OBSERVATION`; those of a burn-in too. Before the first one, that one is repeated.
        actions: the actions that led to these observations, float32 (n, history, 3), so the last action
            first. Before the first action they are zero.
        step: the step of each episode, counted from 0, int64 (n,).
        draws: independent random numbers, uniform on (0, 1), float64 (n, draws).
        episode_draws: random numbers of the episode, which are the same at each of its steps, float64
            (n, episode_draws).
        memory: the numbers that the policy returned at the step before, float64 (n, memory); zeros at the
            start of an episode.
    """

    observations: Float32s
    actions: Float32s
    step: Steps
    draws: Floats
    episode_draws: Floats
    memory: Floats

    def apply(self, change: Callable[[Any], Any]) -> Observed:
        """The same with each array changed, for instance cut to some of the episodes."""
        return Observed._make(map(change, self))

    def cut(self, needs: Needs) -> Observed:
        """The first numbers of each kind, as many as these needs say."""
        return Observed(
            np.ascontiguousarray(self.observations[:, : needs.history]),
            np.ascontiguousarray(self.actions[:, : needs.history]),
            self.step,
            np.ascontiguousarray(self.draws[:, : needs.draws]),
            np.ascontiguousarray(self.episode_draws[:, : needs.episode_draws]),
            np.ascontiguousarray(self.memory[:, : needs.memory]),
        )


class Decision(NamedTuple):
    """What a policy answers about n episodes at one step.

    Attributes:
        action: the `Distribution` of the action (Δvelocity, Δgain, Δshift) of each episode, or the actions
            themselves, (n, 3), whose density is then unknown unless the policy is deterministic. The caller
            draws from the distribution, clips to [-1, 1], and rounds to float32.
        memory: the numbers that the policy will be given at the next step, float64 (n, memory).
    """

    action: Distribution | npt.ArrayLike
    memory: npt.ArrayLike


class FrozenModel(BaseModel):
    """An immutable model of a YAML block, in which unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, ignored_types=(Needs,), defer_build=True)

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Return a copy that is checked as a new block is, and takes over nothing that was computed.

        Raises pydantic's ValidationError where the options are not valid.
        """
        options = {**super().model_copy(deep=deep).options(), **(update or {})}
        return self.model_validate(options, context=self.checked_with)

    @property
    def checked_with(self) -> dict[str, Any]:
        """What a copy is checked with: the `folder` of files, and known `weights` by their SHA-256."""
        context: dict[str, Any] = {"weights": {}}
        for policy in self.inner:
            weights = {**context["weights"], **policy.checked_with["weights"]}
            context = {**policy.checked_with, **context, "weights": weights}
        return context

    def __eq__(self, other: object) -> bool:
        return isinstance(other, type(self)) and self.options() == other.options()

    def options(self) -> dict[str, Any]:
        """The options of the block by name, as they are."""
        return {name: getattr(self, name) for name in type(self).model_fields}

    @cached_property
    def inner(self) -> tuple[Policy, ...]:
        """The policies of which this one is made: those in its options, in order."""
        return tuple(_policies_in(self.options()))

    def everywhere(self, kind: type[Kind]) -> Iterator[Kind]:
        """Yield those of a class among this block and all policies of which it is made, at any depth."""
        if isinstance(self, kind):
            yield self
        for policy in self.inner:
            yield from policy.everywhere(kind)

    def mapped(self, change: Callable[[Policy], Policy]) -> Self:
        """A copy in which each policy of `inner` is changed."""
        if not self.inner:
            return self
        options = {name: _mapped(getattr(self, name), change) for name in type(self).model_fields}
        return self.with_options(**options)

    def with_options(self, **options: Any) -> Self:
        """A copy with other options, which are valid, and nothing that was computed."""
        copy = self.__copy__()
        vars(copy).clear()
        vars(copy).update({name: getattr(self, name) for name in type(self).model_fields} | options)
        return copy

    def plain(self) -> dict[str, Any]:
        """The block as plain data for YAML, including all defaults."""
        return self.model_dump(mode="json", exclude_none=True)

    def difference(self, recorded: Any) -> str | None:
        """The first option that differs in recorded plain data; None if these mean the same.

        Data are recorded with all defaults. So an option that they lack is one that an older ibdata did not
        have, and it must have its default here.
        """
        return _difference(self, self.plain(), recorded)

    def __getstate__(self) -> dict[Any, Any]:
        """What is pickled: nothing that was computed."""
        fields = {name: getattr(self, name) for name in type(self).model_fields}
        return {**super().__getstate__(), "__dict__": fields}

    def loaded(self, acting: Acting) -> Self:
        """A copy in which all objects of users are loaded, so that they can act until `acting` ends."""
        return self.mapped(lambda policy: policy.loaded(acting))


def other_density(policy: Any) -> str | None:
    """The problem of a policy or an object that states a density beside its actions; None otherwise."""
    for method in ("log_density", "log_prob"):
        if callable(getattr(policy, method, None)):
            name = policy.__name__ if isinstance(policy, type) else type(policy).__name__
            return (
                f"{name}: found {method}, expected decide to return Decision(distribution, memory), such as "
                "Decision(ClippedNormal(mean, sd), memory), which has its density; see "
                "the page 'Custom policies'"
            )
    return None


class Policy(FrozenModel):
    """Base class of behaviour policies: write `decide`, state what it `needs`, run `check_policy`.

    A subclass defines a default for `kind: Literal["…"]`, its options as further fields, `decide` and
    `needs`. All are pure functions, and none sees the hidden state.
    """

    kind: str
    name: Name | None = Field(default=None, description="label in the data; default: the kind")

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        if problem := other_density(cls):
            raise TypeError(problem)

    @property
    def needs(self) -> Needs:
        """What it is given; by default the last observation and action, and no random numbers."""
        return Needs()

    def decide(self, observed: Observed) -> Decision:
        """Return how n episodes act at one step, and what to remember (n, memory)."""
        raise TypeError(
            f"{type(self).__name__}: found no decide(observed), expected one that returns a Decision"
        )

    @property
    def label(self) -> str:
        """The policy's label in the data."""
        return self.name or self.kind

    def labelled(self, label: str) -> Self:
        """The policy with a label that a user gave, which need not be a name: a copy, unless it has that."""
        return self if label == self.label else self.with_options(name=label)

    def form(self) -> dict[str, Any]:
        """The kind and the options that differ from their defaults, from which digests are computed."""
        plain = self.model_dump(mode="json", exclude={"name"}, exclude_defaults=True)
        return {"kind": self.kind, **{key: _form(getattr(self, key), inner) for key, inner in plain.items()}}

    def is_same(self, other: Policy) -> bool:
        """Whether another policy acts as this one does: it has the same class and form."""
        return type(self) is type(other) and self.form() == other.form()


def _difference(value: Any, plain: Any, recorded: Any, *keys: object) -> str | None:
    """The first place where recorded data differ from the value of an option, which is `plain`."""
    pairs: list[tuple[object, Any, Any, Any]] = []
    if type(plain) is type(recorded) is dict:
        fields = type(value).model_fields if isinstance(value, FrozenModel) else {}
        options = {name: getattr(value, name) for name in fields} or value
        for name in {**plain, **recorded}:
            is_new = name in fields and name not in recorded
            if not is_new or options[name] != fields[name].get_default(call_default_factory=True):
                pairs.append((name, options.get(name), plain.get(name), recorded.get(name)))
    elif type(plain) is type(recorded) is list and len(plain) == len(recorded):
        pairs = list(zip(range(len(plain)), value, plain, recorded, strict=True))
    elif type(plain) is not type(recorded) or plain != recorded:
        found, expected = ("nothing" if x is None else excerpt(x) for x in (recorded, plain))
        return f"{'.'.join(map(str, keys))}: found {found}, expected {expected}"
    differences = (_difference(*inner, *keys, key) for key, *inner in pairs)
    return next(filter(None, differences), None)


def _policies_in(value: Any) -> Iterator[Policy]:
    """Yield the policies in the value of an option, without those of which they are made."""
    if isinstance(value, Policy):
        yield value
        return
    items = value.options() if isinstance(value, FrozenModel) else value
    if type(items) in (list, tuple, dict):  # not those of a user's class, which may act
        for item in items.values() if isinstance(items, dict) else items:
            yield from _policies_in(item)


def _mapped(value: Any, change: Callable[[Policy], Policy]) -> Any:
    """The value of an option in which each policy is changed."""
    if isinstance(value, Policy):
        return change(value)
    if isinstance(value, FrozenModel):
        return value.mapped(change)
    if type(value) is dict:
        return {key: _mapped(item, change) for key, item in value.items()}
    return type(value)(_mapped(item, change) for item in value) if type(value) in (list, tuple) else value


def _form(value: Any, plain: Any) -> Any:
    """The plain data of an option, in which each policy is replaced by its form."""
    if isinstance(value, Policy):
        return value.form()
    if type(value) in (list, tuple):
        return [_form(*pair) for pair in zip(value, plain, strict=True)]
    items = value.options() if isinstance(value, FrozenModel) else value
    return {key: _form(items[key], inner) for key, inner in plain.items()} if type(items) is dict else plain


class Deterministic(Policy):
    """A policy whose action is certain, given what is known before it; so it has the probability 1."""


def is_deterministic(policy: Policy) -> TypeGuard[Deterministic]:
    """Whether a policy's action is certain, given what is known before it, by class or by promise."""
    return isinstance(policy, Deterministic) or getattr(policy, "deterministic", False)


def at_start(observations: Float32s, needs: Needs, draws: Floats | None = None) -> Observed:
    """What a policy is given at the first step of n episodes with these observations (n, history, 6).

    Random numbers are ½ where none are given.

    >>> at_start(np.zeros((2, 1, 6), dtype=np.float32), Needs()).actions.shape
    (2, 1, 3)
    """
    n, history = observations.shape[:2]
    return Observed(
        observations,
        np.zeros((n, history, 3), dtype=np.float32),
        np.zeros(n, dtype=np.int64),
        np.full((n, needs.draws), 0.5) if draws is None else draws,
        np.full((n, needs.episode_draws), 0.5),
        np.zeros((n, needs.memory)),
    )
