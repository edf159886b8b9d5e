"""Policies that are foreign code: objects that act, and `kind: custom`, which an experiment names."""

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


importing = RLock()  # held by who imports modules of policies, or takes them out of sys.modules
started_in: ContextVar[str | None] = ContextVar("started_in", default=None)  # where a run began


class CustomError(IbdataError):
    """The code of a custom policy cannot be loaded."""


def find_modules_here() -> None:
    """Make modules of the current folder importable, as `python -m` does; that in which the run began."""
    here = started_in.get() or os.getcwd()
    if here not in sys.path:
        sys.path.insert(0, here)


class Adapter(Policy):
    """A policy made of an object with `act(history, u)`, or `predict(observations)` as in SB3 and d3rlpy."""

    @property
    @abstractmethod
    def adapted(self) -> Any:
        """The object."""

    def act(self, history: History, u: Floats) -> npt.ArrayLike:
        if hasattr(self.adapted, "act"):
            actions: npt.ArrayLike = self.adapted.act(history, u)
            return actions
        answer = self.adapted.predict(history.reshape(len(history), -1).copy())
        predicted: npt.ArrayLike = answer[0] if isinstance(answer, tuple) else answer  # SB3: and a state
        return predicted

    def log_prob(self, history: History, action: npt.NDArray[np.float32]) -> Floats:
        if not hasattr(self.adapted, "log_prob"):
            return super().log_prob(history, action)
        density: Floats = self.adapted.log_prob(history, action)
        return density


class Custom(Adapter):
    """The object that `target` names, or that it makes of `params` if it is a class or a function.

    It has `act(history, u)` as the policies here do, or `predict(observations)` as those of SB3 and d3rlpy:
    there observations (n, 6 · history) are float32, newest frame first, and what comes back are actions
    (n, 3), or a tuple that begins with them. `log_prob` is used where there is one. Modules of the current
    folder are found. Nothing is imported before a run begins. What it prints goes to stderr.
    """

    kind: Literal["custom"] = "custom"
    target: Annotated[str, Field(pattern=TARGET)] = Field(description="package.module:name")
    params: Parameters = Field(default={}, description="keywords for a class or function")
    history: Annotated[int, Field(strict=True, ge=1, le=1000)] = Field(
        default=1, description="frames of history it sees"
    )
    uniforms: Annotated[int, Field(strict=True, ge=0, le=1000)] = Field(
        default=0, description="uniform draws per step that act gets"
    )
    files: list[str] | None = Field(
        default=None,
        description="paths of what else it reads, such as weights.pt, beside the YAML file or in the current "
        "folder; they are hashed as its code is",
    )

    @property
    def code_target(self) -> str | None:
        """The target."""
        return self.target

    @property
    def history_length(self) -> int:  # type: ignore[override]  # read from instances only
        """Observations of history that it wants."""
        return self.history

    @property
    def uniforms_per_step(self) -> int:  # type: ignore[override]
        """Uniform draws per step."""
        return self.uniforms

    def form(self) -> dict[str, Any]:
        """As every policy's: the files are recorded with the run, as the code is."""
        return {key: value for key, value in super().form().items() if key != "files"}

    def load(self) -> None:
        """Import or make the object, unless that was done before. Raises CustomError if that fails."""
        _ = self.adapted

    @cached_property
    def adapted(self) -> Any:
        """The object; imported, or made, when first used."""
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
                f"{self.target}: found {type(own).__name__}, expected it to have act or predict"
            )
        return own

    def act(self, history: History, u: Floats) -> npt.ArrayLike:
        with redirect_stdout(sys.stderr):
            return super().act(history, u)

    def log_prob(self, history: History, action: npt.NDArray[np.float32]) -> Floats:
        with redirect_stdout(sys.stderr):
            return super().log_prob(history, action)
