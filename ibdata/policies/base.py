"""What a policy is: a frozen block of options and two pure functions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Annotated, Any, ClassVar

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from ibdata.policies.actions import applied

History = npt.NDArray[np.float32]
Floats = npt.NDArray[np.float64]

NAME_PATTERN = r"^[a-z0-9][a-z0-9_-]{0,63}$"
Name = Annotated[str, Field(pattern=NAME_PATTERN)]

# Columns of an observation vector, in the order of the published IB data.
OBSERVATION = ("setpoint", "velocity", "gain", "shift", "fatigue", "consumption")
SETPOINT, VELOCITY, GAIN, SHIFT, FATIGUE, CONSUMPTION = range(6)


def _no_denormal(least: float) -> AfterValidator:
    """Refuses what is nearer to 0 than the least normal number; a library may make processors take it for 0.

    It stands last in an annotation: the JSON schema shows no bounds that stand behind it.
    """

    def check(value: float) -> float:
        if 0.0 < abs(value) < least:
            bound = f"at least {least!r}" if value > 0.0 else f"at most {-least!r}"
            raise ValueError(f"found {value!r}, which some machines take for 0; expected {bound}")
        return value

    return AfterValidator(check)


NormalSingle = _no_denormal(float(np.finfo(np.float32).tiny))  # for what becomes float32
NormalDouble = _no_denormal(float(np.finfo(np.float64).tiny))


class FrozenModel(BaseModel):
    """A YAML block that is the thing itself: unknown keys are errors, values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Policy(FrozenModel, ABC):
    """A behaviour policy. A subclass in a file of this folder is all it takes to add one.

    It names its `kind: Literal["…"]`, its options as fields, the number of observations it sees
    (`history_length`; 0: none), and the number of uniform draws it uses per step (`uniforms_per_step`). It
    sees nothing but observations. `Deterministic` and `Wrapper` below do part of the work.
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
        """The `package.module:name` of somebody's code, which runs only where that is allowed; else None."""
        return None

    def form(self) -> dict[str, Any]:
        """What the policy is, for digests: its kind and the options that differ from their defaults."""
        return {"kind": self.kind, **self.model_dump(mode="json", exclude={"name"}, exclude_defaults=True)}

    @abstractmethod
    def act(self, history: History, u: Floats) -> npt.ArrayLike:
        """Actions (n, 3) = (Δv, Δg, Δh), clipped to [-1, 1] and rounded to float32 by the caller.

        history (n, history_length, 6) holds observations in the order of `OBSERVATION`, newest first, the
        first one repeated at the start; u (n, uniforms_per_step) is U(0, 1). A pure function.
        """

    def log_prob(self, history: History, action: npt.NDArray[np.float32]) -> Floats:
        """Log density (n,) of actions (n, 3) given histories (n, history_length, 6).

        The measure is Lebesgue's on (-1, 1) plus unit masses at ±1 and at a base policy's own float32
        action, in each dimension (or at its whole action, where it is replaced as a whole). NaN where no
        density is known.
        """
        return np.full(len(action), np.nan)


class Deterministic(Policy):
    """A policy whose action follows from the history: all mass lies at it."""

    def mean_action(self, history: History) -> npt.NDArray[np.float32]:
        """The actions (n, 3) as they are applied."""
        return applied(self.act(history, np.empty((len(history), 0))))

    def log_prob(self, history: History, action: npt.NDArray[np.float32]) -> Floats:
        return np.where((action == self.mean_action(history)).all(axis=1), 0.0, -np.inf)


def _without_name(base: Policy) -> Policy:
    if base.name is not None:
        raise ValueError("found a base with a name, expected the name beside the outer kind")
    return base


Unnamed = AfterValidator(_without_name)


class Wrapper(Policy):
    """A policy around another, its `base`, whose history and draws it passes on; the base's come first."""

    own_uniforms_per_step: ClassVar[int]

    base: Policy

    @property
    def history_length(self) -> int:  # type: ignore[override]  # read from instances only
        """Observations of history that the base wants."""
        return self.base.history_length

    @property
    def uniforms_per_step(self) -> int:  # type: ignore[override]  # read from instances only
        """Uniform draws per step: the base's and its own."""
        return self.base.uniforms_per_step + self.own_uniforms_per_step

    @property
    def code_target(self) -> str | None:
        """That of the base."""
        return self.base.code_target

    def form(self) -> dict[str, Any]:
        """As every policy's, with the form of the base."""
        return {**super().form(), "base": self.base.form()}

    def split(self, history: History, u: Floats) -> tuple[npt.NDArray[np.float32], Floats]:
        """The base's action (n, 3) as it would be applied, and the draws left (n, own draws)."""
        n = self.base.uniforms_per_step
        return applied(self.base.act(history, np.ascontiguousarray(u[:, :n]))), np.ascontiguousarray(u[:, n:])
