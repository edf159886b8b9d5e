"""A policy that is somebody's own code; it runs only where that was allowed."""

from __future__ import annotations

import os
import sys
from functools import cached_property
from importlib import import_module
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from ibdata.errors import IbdataError
from ibdata.policies.base import Floats, History, Policy
from ibdata.policies.parameters import Parameters

TARGET = r"^[A-Za-z_][A-Za-z0-9_]*(\.[A-Za-z_][A-Za-z0-9_]*)*:[A-Za-z_][A-Za-z0-9_]*$"


class CustomError(IbdataError):
    """The code of a custom policy cannot be loaded."""


class Custom(Policy):
    """The object that `target` names, or that it makes of `params` if it is a class or a function.

    It has `act(history, u)` as the policies here do, or `predict(observations)` as those of SB3 and d3rlpy:
    there observations (n, 6 · history) are float32, newest frame first, and what comes back are actions
    (n, 3), or a tuple that begins with them. `log_prob` is used where there is one. Modules of the current
    folder are found. Nothing is imported before the first action.
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

    @property
    def code_target(self) -> str | None:
        """The target."""
        return self.target

    @property
    def frames(self) -> int:  # type: ignore[override]  # read from instances only
        """Observations of history that it wants."""
        return self.history

    @property
    def draws(self) -> int:  # type: ignore[override]
        """Uniform draws per step."""
        return self.uniforms

    @cached_property
    def _own(self) -> Any:
        module, _, name = self.target.partition(":")
        if os.getcwd() not in sys.path:
            sys.path.insert(0, os.getcwd())  # as python -m does
        try:
            found = getattr(import_module(module), name)
            own = found(**self.params) if callable(found) else found
        except Exception as error:
            raise CustomError(f"{self.target}: cannot be loaded: {type(error).__name__}: {error}") from error
        if not (hasattr(own, "act") or hasattr(own, "predict")):
            raise CustomError(
                f"{self.target}: found {type(own).__name__}, expected it to have act or predict"
            )
        return own

    def act(self, history: History, u: Floats) -> npt.ArrayLike:
        if hasattr(self._own, "act"):
            actions: npt.ArrayLike = self._own.act(history, u)
            return actions
        answer = self._own.predict(np.ascontiguousarray(history).reshape(len(history), -1))
        taken: npt.ArrayLike = answer[0] if isinstance(answer, tuple) else answer
        return taken

    def log_prob(self, history: History, action: npt.NDArray[np.float32]) -> Floats:
        if hasattr(self._own, "log_prob"):
            density: Floats = self._own.log_prob(history, action)
            return density
        return super().log_prob(history, action)
