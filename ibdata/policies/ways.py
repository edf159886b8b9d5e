"""The ways in which an object that is not ibdata's can act, and how it is called."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.errors import IbdataError, UsageError, excerpt
from ibdata.policies.actions import as_numbers
from ibdata.policies.base import Floats, Policy
from ibdata.policies.given import Given
from ibdata.policies.user_code import told
from ibdata.policies.wrapper import part_of

WAYS = "an object with act(history, u) or predict(observations), a torch module, or a function"
METHODS = ("act", "predict", "decide")
OLDEST_FIRST = {"VecFrameStack", "FrameStackObservation"}  # of SB3 and of Gymnasium
KEYWORDS = {"state", "episode_start", "deterministic"}  # of predict, as in SB3


class AnswerError(Exception):
    """An object raised an exception, or returned no actions, or other ones than before."""


def can_act(target: Any) -> bool:
    """Whether an `Adapter` can be made of an object."""
    return not isinstance(target, type) and (has_method(target) or callable(target))


def has_method(target: Any) -> bool:
    """Whether an object has one of the methods by which it can act."""
    return any(callable(getattr(target, name, None)) for name in METHODS)


def is_torch_module(target: Any) -> bool:
    """Whether an object is a `torch.nn.Module`. Torch is not imported: without it there are no modules."""
    return isinstance(target, getattr(sys.modules.get("torch.nn"), "Module", ()))


def decides(target: Any) -> bool:
    """Whether an object acts by `decide`: a policy that may remember, or an object without another way."""
    if isinstance(target, Policy):
        return not target.is_short
    found = [name for name in METHODS if callable(getattr(target, name, None))]
    return found == ["decide"]


class Answer(NamedTuple):
    """What an object answers: actions (n, 3), memory (n, memory_size), and the state for the next step."""

    actions: Floats
    memory: Floats
    state: Any = None


class Way:
    """The way in which an object acts, and whether it begins anew by `reset`."""

    def __init__(self, own: Any) -> None:
        self.own = own
        self.decides = decides(own)
        self.acts = not self.decides and callable(getattr(own, "act", None))
        module = is_torch_module(own) and not has_method(own)
        self.call = _module_call(own) if module else getattr(own, "predict", own)
        self.keywords = set() if module or self.decides or self.acts else _keywords(self.call)
        self.scale = _scale(own)
        reset = getattr(own, "reset", None)
        self.reset = reset if callable(reset) and not isinstance(own, Policy) else None

    @property
    def may_remember(self) -> bool:
        """Whether the object may keep something for the next step other than its memory."""
        return self.reset is not None or "state" in self.keywords

    def begin(self, n: int) -> None:
        """Tell the object that n episodes begin, if it wants to know."""
        if self.reset is not None:
            _called(f"reset with {n} episodes", self.reset, *((n,) if _takes_one(self.reset) else ()))

    def ask(self, given: Given, state: Any) -> Answer:
        """Return what the object answers, given copies that it may change.

        Raises AnswerError if it fails, or returns no actions (n, 3), or no memory (n, memory_size).
        """
        n, length = given.observations.shape[:2]
        if self.decides:
            return self._decide(given)
        if self.acts:
            text = f"histories {given.observations.shape} and random numbers {given.uniforms.shape}"
            answer = _called(text, self.own.act, given.observations.copy(), given.uniforms.copy())
            return Answer(_numbers(text, answer, (n, 3)), given.memory)
        shape = (n, length * given.observations.shape[2])
        text = f"{shape}, history={length}"
        known = {"state": state, "episode_start": given.step == 0, "deterministic": True}
        options = {name: known[name] for name in self.keywords}
        seen = self.scale(given.observations.reshape(shape).copy())
        answer = _called(text, self.call, seen, **options)
        actions, *rest = answer if isinstance(answer, tuple) and answer else (answer,)
        kept = rest[0] if rest and "state" in self.keywords else None
        return Answer(_numbers(text, actions, (n, 3)), given.memory, kept)

    def part(self, given: Given) -> Given:
        """What the object itself is given: a policy of ibdata, as many columns as it uses."""
        return part_of(self.own, given) if isinstance(self.own, Policy) else given

    def _decide(self, given: Given) -> Answer:
        part = self.part(given)
        text = f"observations {part.observations.shape} and memory {part.memory.shape}"
        answer = _called(text, self.own.decide, part.apply(np.copy))
        if not (isinstance(answer, tuple) and len(answer) == 2):
            raise AnswerError(f"found {type(answer).__name__}, expected a Decision of actions and memory")
        actions = _numbers(text, answer[0], (len(part.step), 3))
        return Answer(
            actions, _numbers(text, answer[1], part.memory.shape) if part.memory.size else part.memory
        )


def _scale(own: Any) -> Callable[[Any], Any]:
    """What observations go through first: a VecNormalize of SB3, which a model leaves to its environment."""
    find = getattr(own, "get_vec_normalize_env", None)
    if not callable(find):
        return lambda observations: observations
    refuse_frame_stack(own)
    env = find()
    return env.normalize_obs if env is not None and env.norm_obs else lambda observations: observations


def refuse_frame_stack(model: Any) -> None:
    """Raise UsageError if the environment of a model of SB3 puts the oldest observation first."""
    env: Any = getattr(model, "get_env", lambda: None)()
    names = []
    stack = getattr(sys.modules.get("gymnasium.wrappers"), "FrameStackObservation", None)
    with suppress(OSError, EOFError):  # the processes of the environment have ended
        if stack and hasattr(env, "env_is_wrapped") and any(env.env_is_wrapped(stack)):
            names.append(stack.__name__)
    while env is not None:
        names.append(type(env).__name__)
        env = getattr(env, "__dict__", {}).get("venv")
    if found := OLDEST_FIRST & set(names):
        raise UsageError(
            f"model: found {found.pop()}, which puts the oldest observation first, expected the newest "
            "first; train on an environment with the option history"
        )


def _called(given: str, call: Callable[..., Any], *arrays: Any, **options: Any) -> Any:
    """What a call of the object returns; AnswerError if it raises an exception."""
    try:
        return call(*arrays, **options)
    except (IbdataError, KeyboardInterrupt):  # raised by a signal handler, for example
        raise
    except BaseException as error:  # user code must not end the run
        raise AnswerError(f"{told(error)}; it was given {given}") from error


def _numbers(given: str, answer: Any, shape: tuple[int, ...]) -> Floats:
    """What the object returned as an array of its own; AnswerError if it has another shape."""
    try:
        numbers = np.array(as_numbers(answer))
    except (TypeError, ValueError):
        numbers = np.empty(())
    if numbers.shape != shape:
        found = numbers.shape or excerpt(answer)
        raise AnswerError(f"it was given {given}; it returned {found}; expected {shape}")
    return numbers


def _keywords(call: Any) -> set[str]:
    """Those of the keywords that a function has after its first parameter, which is the observations."""
    own = [p.name for p in _parameters(call)[1:] if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
    return KEYWORDS.intersection(own)


def _takes_one(call: Any) -> bool:
    """Whether a function takes a positional argument."""
    named = (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.VAR_KEYWORD)
    return any(p.kind not in named for p in _parameters(call))


def _parameters(call: Any) -> list[inspect.Parameter]:
    try:
        return list(inspect.signature(call).parameters.values())
    except (TypeError, ValueError):  # of a function in C
        return []


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
