"""Policies whose code is not part of ibdata: objects that act, and `kind: custom` of an experiment."""

from __future__ import annotations

import os
import sys
from abc import abstractmethod
from contextlib import redirect_stdout
from contextvars import ContextVar
from functools import cached_property
from importlib import import_module
from threading import RLock
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from ibdata.errors import IbdataError
from ibdata.policies.base import Floats, History, Policy
from ibdata.policies.parameters import Parameters

TARGET = r"^[A-Za-z_][A-Za-z0-9_]*(\.[A-Za-z_][A-Za-z0-9_]*)*:[A-Za-z_][A-Za-z0-9_]*$"

# The current folder at the start of a run.
started_in: ContextVar[str | None] = ContextVar("started_in", default=None)
importing = RLock()  # held while modules of policies are imported or taken out of sys.modules


class CustomError(IbdataError):
    """The code of a custom policy cannot be loaded."""


def find_modules_here() -> None:
    """Make modules of the folder in which the run began importable, as `python -m` does."""
    here = started_in.get() or os.getcwd()
    if here not in sys.path:
        sys.path.insert(0, here)


class Adapter(Policy):
    """A policy made of an object with `act(history, u)` or, as in SB3 and d3rlpy, `predict(observations)`."""

    @property
    @abstractmethod
    def adapted(self) -> Any:
        """The object."""

    def act(self, history: History, u: Floats) -> npt.ArrayLike:
        if hasattr(self.adapted, "act"):
            actions: npt.ArrayLike = self.adapted.act(history, u)
            return actions
        answer = self.adapted.predict(history.reshape(len(history), -1).copy())
        predicted: npt.ArrayLike = answer[0] if isinstance(answer, tuple) else answer  # SB3 adds a state
        return predicted

    def log_prob(self, history: History, action: npt.NDArray[np.float32]) -> Floats:
        if not hasattr(self.adapted, "log_prob"):
            return super().log_prob(history, action)
        density: Floats = self.adapted.log_prob(history, action)
        return density


class Custom(Adapter):
    """Acts by the object that `target` names or, as a class or a function, makes from `params`.

    The object has a method `act(history, u)` like the policies here, or `predict(observations)` like those of
    SB3 and d3rlpy. `predict` takes float32 observations (n, 6 · history), newest first, and returns actions
    (n, 3), or a tuple that begins with them. A method `log_prob` is used if there is one. The module may be
    in the current folder. It is not imported before a run begins. What its code prints goes to stderr.
    """

    kind: Literal["custom"] = "custom"
    target: Annotated[str, Field(pattern=TARGET)] = Field(description="package.module:name")
    params: Parameters = Field(default={}, description="keyword arguments for a class or a function")
    history: Annotated[int, Field(strict=True, ge=1, le=1000)] = Field(
        default=1, description="number of observations that it sees"
    )
    uniforms: Annotated[int, Field(strict=True, ge=0, le=1000)] = Field(
        default=0, description="number of uniform random numbers per step for act"
    )
    files: list[str] | None = Field(
        default=None,
        description="paths of other files that it reads, such as weights.pt, beside the YAML file or in the "
        "current folder; they are hashed like its code",
    )

    @property
    def code_target(self) -> str | None:
        """The target."""
        return self.target

    @property
    def history_length(self) -> int:  # type: ignore[override]  # read from instances only
        """The number of observations that the object sees."""
        return self.history

    @property
    def uniforms_per_step(self) -> int:  # type: ignore[override]
        """The number of uniform random numbers per step."""
        return self.uniforms

    def form(self) -> dict[str, Any]:
        """The kind and the options, without the files, which are recorded with the run like the code."""
        return {key: value for key, value in super().form().items() if key != "files"}

    def load(self) -> None:
        """Import or create the object, unless this was done before. Raises CustomError if it fails."""
        _ = self.adapted

    @cached_property
    def adapted(self) -> Any:
        """The object, which is imported or created on first use."""
        module, _, name = self.target.partition(":")
        find_modules_here()
        try:
            with importing, redirect_stdout(sys.stderr):  # stdout is for a command's results
                found = getattr(import_module(module), name)
                own = found(**self.params) if callable(found) else found
        except (Exception, SystemExit) as error:
            raise CustomError(f"{self.target}: cannot be loaded: {type(error).__name__}: {error}") from error
        if not (hasattr(own, "act") or hasattr(own, "predict")):
            raise CustomError(
                f"{self.target}: found {type(own).__name__}, expected an object with act or predict"
            )
        return own

    def act(self, history: History, u: Floats) -> npt.ArrayLike:
        with redirect_stdout(sys.stderr):
            return super().act(history, u)

    def log_prob(self, history: History, action: npt.NDArray[np.float32]) -> Floats:
        with redirect_stdout(sys.stderr):
            return super().log_prob(history, action)
