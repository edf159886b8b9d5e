"""Policies made of objects that are not ibdata's: with `act` or `predict`, torch modules, and functions."""

from __future__ import annotations

import sys
from abc import abstractmethod
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.errors import IbdataError
from ibdata.policies.actions import as_numbers
from ibdata.policies.base import Floats, History, Policy
from ibdata.policies.support import Support
from ibdata.policies.user_code import told

WAYS = "an object with act(history, u) or predict(observations), a torch module, or a function"


class AnswerError(Exception):
    """An object raised an exception, or returned no actions. The text also says what it was given."""


def can_act(target: Any) -> bool:
    """Whether an `Adapter` can be made of an object."""
    return not isinstance(target, type) and (has_method(target) or callable(target))


def has_method(target: Any) -> bool:
    """Whether an object has `act` or `predict`."""
    return any(callable(getattr(target, name, None)) for name in ("act", "predict"))


def is_torch_module(target: Any) -> bool:
    """Whether an object is a `torch.nn.Module`. Torch is not imported: without it there are no modules."""
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(target, torch.nn.Module)


class Adapter(Policy):
    """A policy made of an object that acts in one of four ways, of which the first that it has is used.

    - `act(history, u)`, as a `Policy` of ibdata;
    - `predict(observations)`, as in SB3 and d3rlpy;
    - a torch module, called on a float32 tensor of the observations, in evaluation mode without gradients;
    - any other callable, called on the observations.

    Observations are float32 (n, 6 · history), newest first. The answer is (n, 3), or except from `act` a
    tuple that begins with it. The object may change the arrays that it is given, which are copies.
    """

    @property
    @abstractmethod
    def adapted(self) -> Any:
        """The object."""

    def act(self, history: History, u: Floats) -> npt.ArrayLike:
        own, n, length = self.adapted, len(history), self.history_length
        if callable(getattr(own, "act", None)):
            given = f"histories {history.shape} and random numbers {u.shape}"
            return _asked(given, n, own.act, history.copy(), u.copy())
        flat = history.reshape(n, 6 * length).copy()
        way = getattr(own, "predict", _module_call(own) if is_torch_module(own) else own)
        return _asked(f"{flat.shape}, history={length}", n, _first(way), flat)

    def supports(self, step: int) -> tuple[Support, ...] | None:
        own = getattr(self.adapted, "support", None)
        return (own,) if isinstance(own, frozenset) else None

    def log_prob(self, history: History, action: npt.NDArray[np.float32]) -> Floats:
        if not hasattr(self.adapted, "log_prob"):
            return super().log_prob(history, action)
        density: Floats = self.adapted.log_prob(history.copy(), action.copy())
        return density


def _asked(given: str, n: int, way: Any, *arrays: npt.NDArray[Any]) -> Floats:
    """The actions (n, 3) that an object returns; AnswerError if it returns none."""
    try:
        answer = way(*arrays)
    except IbdataError:  # raised by a signal handler, for example
        raise
    except (Exception, SystemExit) as error:  # user code must not end the run
        raise AnswerError(f"{told(error)}; it was given {given}") from error
    try:
        actions = as_numbers(answer)
    except (TypeError, ValueError):
        actions = np.empty(())
    if actions.shape != (n, 3):
        found = actions.shape or " ".join(repr(answer).split())[:60]
        raise AnswerError(f"it was given {given}; it returned {found}; expected ({n}, 3)")
    return actions


def _first(way: Any) -> Any:
    """The call of a function that may return a tuple, such as SB3's actions with a state."""

    def call(observations: npt.NDArray[np.float32]) -> Any:
        answer = way(observations)
        return answer[0] if isinstance(answer, tuple) and answer else answer

    return call


def _module_call(module: Any) -> Any:
    """The call of a torch module, which leaves the modes of its parts as they were."""
    torch = sys.modules["torch"]

    def call(observations: npt.NDArray[np.float32]) -> Any:
        training = [part for part in module.modules() if part.training]
        held = next((tensor for group in (module.parameters(), module.buffers()) for tensor in group), None)
        module.train(False)
        try:
            with torch.no_grad():
                return module(torch.from_numpy(observations).to(held.device if held is not None else "cpu"))
        finally:
            for part in training:
                part.training = True

    return call
