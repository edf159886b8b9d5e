"""The base classes of policies. A policy is an immutable block of options with pure functions."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeGuard

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from ibdata.policies.actions import applied
from ibdata.policies.given import Decision, Given, at_start
from ibdata.policies.support import Piece, Support, whole

if TYPE_CHECKING:
    from typing_extensions import Self

History = npt.NDArray[np.float32]
Floats = npt.NDArray[np.float64]

NAME_PATTERN = r"^[a-z0-9][a-z0-9_-]{0,63}$"
Name = Annotated[str, Field(pattern=NAME_PATTERN)]

# Columns of an observation vector, in the order of the published IB data.
OBSERVATION = ("setpoint", "velocity", "gain", "shift", "fatigue", "consumption")
SETPOINT, VELOCITY, GAIN, SHIFT, FATIGUE, CONSUMPTION = range(6)


def _no_denormal(least: float) -> AfterValidator:
    """A validator that refuses denormal numbers, which processors may treat as 0 if a library tells them to.

    It must be last in an annotation, because the JSON schema leaves out all bounds after it.
    """

    def check(value: float) -> float:
        if 0.0 < abs(value) < least:
            bound = f"at least {least!r}" if value > 0.0 else f"at most {-least!r}"
            raise ValueError(f"found {value!r}, which some machines take for 0; expected {bound}")
        return value

    return AfterValidator(check)


NormalSingle = _no_denormal(float(np.finfo(np.float32).tiny))  # for values that become float32
NormalDouble = _no_denormal(float(np.finfo(np.float64).tiny))


class FrozenModel(BaseModel):
    """An immutable model of a YAML block, in which unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Return a copy that is checked as a new block is, and takes over nothing that was computed.

        Raises pydantic's ValidationError where the options are not valid.
        """
        return self.model_validate({**super().model_copy(deep=deep).options(), **(update or {})})

    def options(self) -> dict[str, Any]:
        """The options of the block by name, as they are."""
        return {name: getattr(self, name) for name in type(self).model_fields}


class Policy(FrozenModel):
    """Base class of behaviour policies. To add a policy, add a module with a subclass to this folder.

    A subclass defines a default for `kind: Literal["…"]`, its options as further fields, and:

    - `history_length`: the number of observations and actions it sees, 0 for none;
    - `uniforms_per_step`: the number of uniform random numbers it uses per step;
    - `act`, and `log_prob` and `support` if its density is known.

    A policy that needs more than observations and random numbers defines `decide` in place of `act`, and
    `log_density` in place of `log_prob`. What it must know later, it returns as memory:

    - `memory_size`: the number of numbers that it remembers from one step to the next;
    - `uniforms_per_episode`: the number of uniform random numbers that are drawn once for an episode.

    A policy never sees the hidden state. `Deterministic` and `Wrapper` below do part of the work, and
    `ibdata.testing.check_policy` checks the result.
    """

    history_length: ClassVar[int] = 1
    memory_size: ClassVar[int] = 0
    uniforms_per_step: ClassVar[int] = 0
    uniforms_per_episode: ClassVar[int] = 0
    support: ClassVar[Support | None] = None

    kind: str
    name: Name | None = Field(default=None, description="label in the data; default: the kind")

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        for short, full in (("act", "decide(given)"), ("log_prob", "log_density(given, action)")):
            name = full.partition("(")[0]
            if (
                short in vars(cls)
                and name not in vars(cls)
                and getattr(cls, name) is not getattr(Policy, name)
            ):
                raise TypeError(
                    f"{cls.__name__}: found {short}, which its base class does not call, expected {full}; "
                    "see docs/extending.md"
                )

    @property
    def label(self) -> str:
        """The policy's label in the data."""
        return self.name or self.kind

    @property
    def code_target(self) -> str | None:
        """The `package.module:name` of foreign code, which runs only if the user allows it; else None."""
        return None

    @property
    def is_short(self) -> bool:
        """Whether actions depend on nothing but the last observations and random numbers of the step."""
        return type(self).decide is Policy.decide

    @property
    def inner(self) -> tuple[Policy, ...]:
        """The policies of which this one is made; none by default."""
        return ()

    def everywhere(self) -> Iterator[Policy]:
        """Yield this policy and all of which it is made, at any depth."""
        yield self
        for policy in self.inner:
            yield from policy.everywhere()

    def form(self) -> dict[str, Any]:
        """The kind and the options that differ from their defaults, from which digests are computed."""
        return {"kind": self.kind, **self.model_dump(mode="json", exclude={"name"}, exclude_defaults=True)}

    def decide(self, given: Given) -> Decision:
        """Return the actions of n episodes at one step, and what to remember. A pure function.

        The caller asks for the steps of an episode in order.

        Args:
            given: everything that the actions may depend on.

        Returns:
            The actions (n, 3) and the memory (n, memory_size).
        """
        return Decision(self.act(given.observations, given.uniforms), given.memory)

    def decide_with_density(self, given: Given) -> tuple[Decision, Floats | None]:
        """Return what `decide` returns, and the log density (n,) of these actions once clipped and rounded.

        None in place of the density means that `log_density` computes it, which is the default. A policy
        that would do most of its work twice computes both here.
        """
        return self.decide(given), None

    def log_density(self, given: Given, action: npt.NDArray[np.float32]) -> Floats:
        """Return the log density of actions, given all that is known before them. A pure function.

        The density is with respect to Lebesgue measure on (-1, 1) plus unit masses at ±1 and at the float32
        action of a base policy: in each dimension, or at the whole action if it is replaced as a whole.

        Args:
            given: as in `decide`.
            action: the actions after clipping and rounding, float32 (n, 3).

        Returns:
            Float64 (n,); NaN where no density is known.
        """
        return self.log_prob(given.observations, action)

    def supports(self, step: int) -> tuple[Support, ...] | None:
        """Return where the density lies at a step; by default, `support` at every step.

        Args:
            step: the step of the episode, counted from 0.

        Returns:
            The supports of the policies of which one acts; None if that is not known.
        """
        return None if self.support is None else (self.support,)

    def atoms(self, given: Given, action: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
        """Whether the measure of the density has a unit mass at each number of an action.

        By default, it has one at ±1, and at all three numbers of an action that is certain.

        Args:
            given: as in `decide`.
            action: as in `log_density`.

        Returns:
            Bool (n, 3).
        """
        edges: npt.NDArray[np.bool_] = np.abs(action) == 1.0
        if not is_deterministic(self):
            return edges
        own: npt.NDArray[np.bool_] = (action == applied(self.decide(given).actions)).all(axis=1)
        return edges | own[:, None]

    def act(self, history: History, u: Floats) -> npt.ArrayLike:
        """Return the actions of n episodes at one step: the short form of `decide`.

        Args:
            history: `Given.observations`.
            u: `Given.uniforms`.

        Returns:
            `Decision.actions`.

        Raises:
            TypeError: the policy defines neither form, or depends on more than history and random numbers.
        """
        if type(self).decide is Policy.decide:
            raise TypeError(f"{type(self).__name__}: found neither act nor decide, expected one of them")
        return self.decide(self._at_start(history, u)).actions

    def log_prob(self, history: History, action: npt.NDArray[np.float32]) -> Floats:
        """Return the log density of actions: the short form of `log_density`; NaN by default.

        Args:
            history: `Given.observations`.
            action: the actions after clipping and rounding, float32 (n, 3).

        Returns:
            Float64 (n,).
        """
        if type(self).log_density is Policy.log_density:
            return np.full(len(action), np.nan)
        return self.log_density(self._at_start(history, np.empty((len(action), 0))), action)

    def _at_start(self, history: History, u: Floats) -> Given:
        if not self.is_short:
            raise TypeError(
                f"{self.label}: found a call of act or log_prob, expected a call of decide or log_density, "
                "because the policy may depend on more than the last observations"
            )
        return at_start(history, u)


class Deterministic(Policy):
    """A policy whose action is certain, given what is known before it; so it has the probability 1."""

    def mean_action(self, history: History) -> npt.NDArray[np.float32]:
        """Return the actions (n, 3), clipped and rounded."""
        return applied(self.act(history, np.empty((len(history), 0))))

    def supports(self, step: int) -> tuple[Support, ...] | None:
        own = json.dumps(self.form(), sort_keys=True)
        drawn = self.uniforms_per_episode > 0
        text = f"a point mass at the action of {self.kind}"
        return (whole(Piece(text + ", drawn for each episode," * drawn, own, drawn)),)

    def decide_with_density(self, given: Given) -> tuple[Decision, Floats | None]:
        return self.decide(given), np.zeros(len(given.step))

    def log_density(self, given: Given, action: npt.NDArray[np.float32]) -> Floats:
        return np.where((action == applied(self.decide(given).actions)).all(axis=1), 0.0, -np.inf)

    def log_prob(self, history: History, action: npt.NDArray[np.float32]) -> Floats:
        return np.where((action == self.mean_action(history)).all(axis=1), 0.0, -np.inf)


def is_deterministic(policy: Policy) -> TypeGuard[Deterministic]:
    """Whether a policy's action is certain, given what is known before it, by class or by promise."""
    return isinstance(policy, Deterministic) or getattr(policy, "deterministic", False)
