"""Objects of users and how they are asked: by `decide`, `act`, `predict`, as torch modules, or by a call."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arguments import has_method
from ibdata._numerics.arrays import Floats
from ibdata.errors import IbdataError, PolicyError, UsageError
from ibdata.policies.base import Needs, Observed, Policy, Steps, other_density
from ibdata.policies.checked import AnswerError, actions, ask, decision, numbers
from ibdata.policies.code import apart_from_results, error_line
from ibdata.policies.distributions import Certain, Distribution, Unknown
from ibdata.policies.libraries import is_torch_module, module_call, normalized

EXPECTED = (
    "an object with decide(observed), act(history, u) or predict(observations), a torch module, or a function"
)
NO_NUMBERS = "no random numbers; if it draws 3 per step, write draws: 3 beside its target in a block"
KEYWORDS = {"state", "episode_start", "deterministic"}  # of predict, as in SB3


class Answer(NamedTuple):
    """What an object answered: an action, see `Decision`, memory, and the state for the next step."""

    action: Distribution | Floats
    memory: Floats
    step: Steps  # (n,), at which it was asked
    state: Any = None  # of predict, for the next step


class Adapter:
    """An object of a user as it is asked: by the first that it has of `decide`, `act`, `predict` and a call.

    The page "Custom policies" says what it is given and returns. The arrays are copies, which it may change.
    Its last answer is kept if the next one depends on it, and numbers that are clipped are counted.
    """

    def __init__(self, target: Any) -> None:
        self.target = target
        self.clipped = np.zeros(2, dtype=np.int64)  # numbers of its actions that are clipped, and all
        self._last: Answer | None = None

    @property
    def remembers(self) -> bool:
        """Whether it has `reset`, or takes the `state` that it returned at the step before."""
        return self._reset is not None or "state" in self._keywords

    def ask(self, observed: Observed) -> Answer:
        """What the object answers. Raises AnswerError, which says what it was given."""
        begins = not observed.step.any()
        before = None if begins else self._last
        follows = before is not None and np.array_equal(observed.step, before.step + 1)
        if self.remembers and not (begins or follows):
            raise AnswerError(
                f"found an object that remembers, asked about step {observed.step[0]}, expected the steps of "
                "the same episodes one by one from step 0; only a policy with decide and memory may begin at "
                "any step"
            )
        try:
            with apart_from_results():
                if self._reset is not None and begins:
                    self._reset(len(observed.step))
                answer = self._call(observed, None if before is None else before.state)
        except (IbdataError, KeyboardInterrupt):
            raise
        except BaseException as error:  # code of users must not end the run
            line = str(error) if isinstance(error, AnswerError) else error_line(error)
            raise AnswerError(f"{line}; it was given {self._shapes(observed)}") from error
        self._last = answer if self.remembers else None
        return answer

    def _shapes(self, observed: Observed) -> str:
        n, history, columns = observed.observations.shape
        if hasattr(self.target, "decide") or hasattr(self.target, "act"):
            numbers = f"random numbers {observed.draws.shape}" if observed.draws.size else NO_NUMBERS
            return f"observations {(n, history, columns)} and {numbers}"
        hint = "; history= gives more than one" if history == 1 else ""
        return f"observations {(n, history * columns)}{hint}"

    def _call(self, observed: Observed, state: Any) -> Answer:
        """Ask the object by the first of its methods."""
        answer: Any
        memory, next_state = observed.memory, None
        if hasattr(self.target, "decide"):
            if isinstance(self.target, Policy):  # of ibdata, which is given as many numbers as it needs
                answer, next_memory = ask(self.target, observed.cut(self.target.needs).apply(np.copy))
                answer = answer.actions if isinstance(answer, Unknown) else answer
            else:
                answer, next_memory = decision(self.target.decide(observed.apply(np.copy)))
            if memory.size:
                memory = numbers(next_memory, memory.shape, "memory").copy()
            if isinstance(answer, Certain):
                self._count_clipped(answer.actions)
            if isinstance(answer, Distribution):
                return Answer(answer, memory, observed.step)
        elif hasattr(self.target, "act"):
            answer = self.target.act(observed.observations.copy(), observed.draws.copy())
        else:
            known = {"state": state, "episode_start": observed.step == 0, "deterministic": True}
            options = {name: known[name] for name in self._keywords}
            answer = self._predict(observed.observations.reshape(len(observed.step), -1).copy(), **options)
            if "state" in self._keywords and isinstance(answer, tuple) and len(answer) > 1:
                next_state = answer[1]
        if isinstance(answer, tuple) and len(answer) > 2:
            raise AnswerError(f"found a tuple of {len(answer)}, expected actions, or actions and a state")
        if isinstance(answer, tuple) and answer:
            answer = answer[0]
        plain = actions(answer, len(observed.step)).copy()
        self._count_clipped(plain)
        return Answer(plain, memory, observed.step, next_state)

    def _count_clipped(self, actions: npt.NDArray[Any]) -> None:
        self.clipped += np.array([np.count_nonzero(np.abs(actions) > 1.0), actions.size])

    @cached_property
    def _reset(self) -> Callable[[int], Any] | None:
        """Tells the object that n episodes begin, if it has a method for that."""
        reset = None if isinstance(self.target, Policy) else getattr(self.target, "reset", None)
        if not callable(reset):
            return None
        named = (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.VAR_KEYWORD)
        takes_one = any(p.kind not in named for p in _parameters(reset))
        return reset if takes_one else lambda n: reset()

    @cached_property
    def _keywords(self) -> set[str]:
        """Those of the keywords that `predict` has after its first parameter, which is the observations."""
        if hasattr(self.target, "decide") or hasattr(self.target, "act"):
            return set()
        rest = _parameters(self._predict)[1:]
        return KEYWORDS & {p.name for p in rest if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)}

    @cached_property
    def _predict(self) -> Callable[..., Any]:
        """What is called on observations."""
        if is_torch_module(self.target) and not has_method(self.target):
            return module_call(self.target)
        return normalized(self.target, getattr(self.target, "predict", self.target))


def has_needs(target: Any) -> bool:
    """Whether an object says itself what it needs. Raises UsageError for `needs` of another type."""
    needs = getattr(target, "needs", None)
    if needs is not None and not isinstance(needs, Needs):
        found = "a method" if callable(needs) else repr(needs)
        raise UsageError(
            f"{type(target).__name__}.needs: found {found}, expected an attribute or a property that is a "
            "Needs(history, draws, episode_draws, memory) of ibdata.policies"
        )
    return needs is not None


def needs_of(target: Any, history: int = 1, draws: int = 0) -> Needs:
    """The needs of an object: its attribute `needs` if it has one, else these."""
    needs: Needs = target.needs if has_needs(target) else Needs(history, draws)
    return needs


def refuse_other_form(actor: Any, place: str, history: int, draws: int) -> None:
    """PolicyError for an object that needs more than these numbers, or states a density itself."""
    if problem := other_density(actor):
        raise PolicyError(f"{place}: {problem}")
    needs = needs_of(actor, history, draws)
    for option, number, least in (("history", history, needs.history), ("draws", draws, needs.draws)):
        if number < least:
            raise PolicyError(
                f"{place}: found {option}: {number}, expected at least the needs of "
                f"{type(actor).__name__}; write {option}: {least}"
            )


def _parameters(call: Any) -> list[inspect.Parameter]:
    try:
        return list(inspect.signature(call).parameters.values())
    except (TypeError, ValueError):  # of a function in C
        return []
