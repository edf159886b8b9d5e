"""The base classes of policies. A policy is an immutable block of options with two pure functions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeGuard

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from ibdata.policies.actions import applied

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


class Policy(FrozenModel, ABC):
    """Base class of behaviour policies. To add a policy, add a module with a subclass to this folder.

    A subclass defines a default for `kind: Literal["…"]`, its options as further fields, and:

    - `history_length`: the number of observations it sees, 0 for none;
    - `uniforms_per_step`: the number of uniform random numbers it uses per step;
    - `act`, and `log_prob` if its density is known.

    A policy sees observations only, never the hidden state. `Deterministic` and `Wrapper` below do part of
    the work, and `ibdata.testing.check_policy` checks the result.
    """

    history_length: ClassVar[int] = 1
    uniforms_per_step: ClassVar[int] = 0

    kind: str
    name: Name | None = Field(default=None, description="label in the data; default: the kind")

    @property
    def label(self) -> str:
        """The policy's label in the data."""
        return self.name or self.kind

    @property
    def code_target(self) -> str | None:
        """The `package.module:name` of foreign code, which runs only if the user allows it; else None."""
        return None

    def form(self) -> dict[str, Any]:
        """The kind and the options that differ from their defaults, from which digests are computed."""
        return {"kind": self.kind, **self.model_dump(mode="json", exclude={"name"}, exclude_defaults=True)}

    @abstractmethod
    def act(self, history: History, u: Floats) -> npt.ArrayLike:
        """Return the actions of n episodes at one step. A pure function.

        Args:
            history: the latest observations, float32 (n, history_length, 6), newest first, with the columns
                of `OBSERVATION`; at the start of an episode its first observation is repeated.
            u: independent random numbers, uniform on (0, 1), float64 (n, uniforms_per_step).

        Returns:
            (Δvelocity, Δgain, Δshift) of each episode, (n, 3); the caller clips them to [-1, 1] and rounds
            them to float32.
        """

    def log_prob(self, history: History, action: npt.NDArray[np.float32]) -> Floats:
        """Return the log density of actions given histories. A pure function.

        The density is with respect to Lebesgue measure on (-1, 1) plus unit masses at ±1 and at the float32
        action of a base policy: in each dimension, or at the whole action if it is replaced as a whole.

        Args:
            history: as in `act`.
            action: the actions after clipping and rounding, float32 (n, 3).

        Returns:
            Float64 (n,); NaN where no density is known, which is the default.
        """
        return np.full(len(action), np.nan)


class Deterministic(Policy):
    """A policy whose action depends on the history alone and so has the probability 1."""

    def mean_action(self, history: History) -> npt.NDArray[np.float32]:
        """Return the actions (n, 3), clipped and rounded."""
        return applied(self.act(history, np.empty((len(history), 0))))

    def log_prob(self, history: History, action: npt.NDArray[np.float32]) -> Floats:
        return np.where((action == self.mean_action(history)).all(axis=1), 0.0, -np.inf)


def is_deterministic(policy: Policy) -> TypeGuard[Deterministic]:
    """Whether a policy's action depends on the history alone, by its class or as its user says."""
    return isinstance(policy, Deterministic) or getattr(policy, "deterministic", False)


def _without_name(base: Policy) -> Policy:
    if base.name is not None:
        raise ValueError("found a name in the base, expected the name beside the outer kind")
    return base


Unnamed = AfterValidator(_without_name)


class Wrapper(Policy):
    """A policy that changes the actions of another one, its `base`.

    It sees the same observations as the base. The base uses the first of its random numbers, the policy
    itself the other `own_uniforms_per_step`; `split` separates them.
    """

    own_uniforms_per_step: ClassVar[int]

    base: Policy

    @property
    def history_length(self) -> int:  # type: ignore[override]  # read from instances only
        """The number of observations that the base sees."""
        return self.base.history_length

    @property
    def uniforms_per_step(self) -> int:  # type: ignore[override]  # read from instances only
        """The number of uniform random numbers per step, of the base and of the policy itself."""
        return self.base.uniforms_per_step + self.own_uniforms_per_step

    @property
    def code_target(self) -> str | None:
        """The code target of the base."""
        return self.base.code_target

    def form(self) -> dict[str, Any]:
        """The form of the policy, which contains the form of the base."""
        return {**super().form(), "base": self.base.form()}

    def split(self, history: History, u: Floats) -> tuple[npt.NDArray[np.float32], Floats]:
        """Return the base's action (n, 3), clipped and rounded, and the policy's own random numbers."""
        n = self.base.uniforms_per_step
        return applied(self.base.act(history, np.ascontiguousarray(u[:, :n]))), np.ascontiguousarray(u[:, n:])
