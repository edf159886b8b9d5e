"""Objects of users as policies: with `decide`, `act` or `predict`, torch modules, and other callables."""

from __future__ import annotations

import inspect
from abc import abstractmethod
from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import numpy.typing as npt
from pydantic import Field, PrivateAttr, model_validator

from ibdata.errors import IbdataError, PolicyError, UsageError
from ibdata.policies.base import OBSERVATION, Decision, Floats, Needs, Observed, Policy, Steps
from ibdata.policies.checked import AnswerError, actions, decision, distribution_of, numbers
from ibdata.policies.code import apart_from_results, error_line
from ibdata.policies.distributions import Certain, Distribution, Unknown
from ibdata.policies.libraries import environment_note, is_torch_module, module_call, normalized
from ibdata.policies.purity import refuse_impure
from ibdata.views.options import PLAIN, ViewOptions

EXPECTED = (
    "an object with decide(observed), act(history, u) or predict(observations), a torch module, or a function"
)
NO_NUMBERS = "no random numbers; if it draws 3 per step, write uniforms: 3 beside its target in a block"
METHODS = ("decide", "act", "predict")
MOST_CLIPPED = 0.2  # share of the numbers of actions
KEYWORDS = {"state", "episode_start", "deterministic"}  # of predict, as in SB3


Counts = npt.NDArray[np.int64]


class Answer(NamedTuple):
    """What an object answered: an action, see `Decision`, memory, and the state for the next step."""

    action: Distribution | Floats
    memory: Floats
    step: Steps  # (n,), at which it was asked
    state: Any = None  # of predict, for the next step


class UserObject(Policy):
    """A policy made of an object that acts by `decide`, `act`, `predict` or a call, the first that it has.

    What it is given and answers is in docs/custom-policies.md. The arrays are copies, which it may change.
    """

    history: Annotated[int, Field(strict=True, ge=1, le=10_000)] = Field(
        default=1, description="number of observations that it sees"
    )
    uniforms: Annotated[int, Field(strict=True, ge=0, le=10_000)] = Field(
        default=0, description="number of uniform random numbers per step for act and decide"
    )
    deterministic: bool = Field(
        default=False, strict=True, description="promise that it draws no random numbers of any kind"
    )

    _is_pure: bool = PrivateAttr(False)

    @model_validator(mode="after")
    def _refuse_draws(self) -> UserObject:
        if self.deterministic and self.uniforms:
            raise ValueError(
                f"found deterministic: true and uniforms: {self.uniforms}, expected only "
                "one of them, because a deterministic policy draws nothing"
            )
        return self

    @property
    @abstractmethod
    def adapted(self) -> Any:
        """The object."""

    @property
    @abstractmethod
    def code_target(self) -> str:
        """What names the object in records and messages."""

    @property
    def needs(self) -> Needs:
        """The options; an object with `decide` also says what it remembers and draws for an episode."""
        needs = needs_of(self.adapted, self.history, self.uniforms)
        return needs._replace(history=self.history, step_draws=self.uniforms)

    def files_used(self) -> dict[str, Path]:
        """The files that it reads, by their names in a record."""
        return {}

    def target_file(self) -> Path | None:
        """The file of its code, if one is known."""
        return None

    @property
    def remembers(self) -> bool:
        """Whether it has `reset`, or takes the `state` that it returned at the step before."""
        return self._reset is not None or "state" in self._keywords

    def decide(self, observed: Observed) -> Decision:
        """What the object answers. Raises PolicyError if it remembers and the steps are not in order."""
        begins = not observed.step.any()
        before: Answer | None = self.__dict__.get("_last")
        if self.remembers and not begins and not (before and np.array_equal(observed.step, before.step + 1)):
            raise PolicyError(
                f"policy {self.label}: found an object that remembers, asked about step {observed.step[0]}, "
                "expected the steps of the same episodes one by one from step 0; only a policy with decide "
                "and memory may begin at any step"
            )
        answer = self._answer(observed, None if begins or before is None else before.state)
        self.__dict__["_last"] = answer if self.remembers else None
        return Decision(answer.action, answer.memory)

    def check_once(self, columns: int = len(OBSERVATION)) -> None:
        """Make the object, and check that it is pure, unless that was done before.

        It sees so many `columns` of an observation. Raises PolicyError if it cannot be loaded, or if it
        remembers or draws in secret.
        """
        if not self._is_pure:
            refuse_impure(self, columns, exact=False)
            self.count_anew()  # what was asked here is made up
            self._is_pure = True

    def forget(self) -> None:
        """Forget the object and its last answer, so that it is made anew on its next use."""
        self._is_pure = False
        for name in ("adapted", "_last", "_predict", "_keywords", "_reset", "_clipped"):
            self.__dict__.pop(name, None)

    def notes(self, view: ViewOptions = PLAIN) -> Iterator[str]:
        """What somebody should know who uses the object with a view, in lines without its name."""
        if note := environment_note(self.adapted, view):
            yield note
        clipped, total = self._clipped
        yield from clipping_notes(clipped, total, "numbers of its actions")

    def count_anew(self) -> None:
        """Forget how many numbers were clipped."""
        self._clipped[:] = 0

    @cached_property
    def _clipped(self) -> Counts:
        """How many numbers of its actions are clipped, and how many there are; bases are clipped early."""
        return np.zeros(2, dtype=np.int64)

    def _answer(self, observed: Observed, state: Any) -> Answer:
        """Ask the object. Raises AnswerError, which says what it was given."""
        try:
            with apart_from_results():
                if self._reset is not None and not observed.step.any():
                    self._reset(len(observed.step))
                return self._call(observed, state)
        except (IbdataError, KeyboardInterrupt):
            raise
        except BaseException as error:  # code of users must not end the run
            line = str(error) if isinstance(error, AnswerError) else error_line(error)
            raise AnswerError(f"{line}; it was given {self._shapes(observed)}") from error

    def _shapes(self, observed: Observed) -> str:
        n, history, columns = observed.observations.shape
        if hasattr(self.adapted, "decide") or hasattr(self.adapted, "act"):
            numbers = f"random numbers {observed.uniforms.shape}" if observed.uniforms.size else NO_NUMBERS
            return f"observations {(n, history, columns)} and {numbers}"
        return f"observations {(n, history * columns)}"

    def _call(self, observed: Observed, state: Any) -> Answer:
        """Ask the object by the first of its methods."""
        memory, next_state = observed.memory, None
        if hasattr(self.adapted, "decide"):
            answer, next_memory = self._decision(observed)
            if memory.size:
                memory = numbers(next_memory, memory.shape, "memory").copy()
            if isinstance(answer, Certain):
                self._count_clipped(answer.actions)
            if isinstance(answer, Distribution):
                return Answer(answer, memory, observed.step)
        elif hasattr(self.adapted, "act"):
            answer = self.adapted.act(observed.observations.copy(), observed.uniforms.copy())
        else:
            answer = self._predicted(observed, state)
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
        self._clipped += np.array([np.count_nonzero(np.abs(actions) > 1.0), actions.size])

    def _predicted(self, observed: Observed, state: Any) -> Any:
        """What `predict` or a call answers, with those of the keywords that it has."""
        known = {"state": state, "episode_start": observed.step == 0, "deterministic": True}
        options = {name: known[name] for name in self._keywords}
        return self._predict(observed.observations.reshape(len(observed.step), -1).copy(), **options)

    def _decision(self, observed: Observed) -> tuple[Any, Any]:
        """What `decide` answers; a policy of ibdata is given as many numbers as it needs."""
        if isinstance(self.adapted, Policy):
            action, memory = distribution_of(self.adapted, observed.cut(self.adapted.needs).apply(np.copy))
            return action.actions if isinstance(action, Unknown) else action, memory
        answer = self.adapted.decide(observed.apply(np.copy))
        return decision(answer)

    @cached_property
    def _reset(self) -> Callable[[int], Any] | None:
        """Tells the object that n episodes begin, if it has a method for that."""
        reset = None if isinstance(self.adapted, Policy) else getattr(self.adapted, "reset", None)
        if not callable(reset):
            return None
        named = (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.VAR_KEYWORD)
        takes_one = any(p.kind not in named for p in _parameters(reset))
        return reset if takes_one else lambda n: reset()

    @cached_property
    def _keywords(self) -> set[str]:
        """Those of the keywords that `predict` has after its first parameter, which is the observations."""
        if hasattr(self.adapted, "decide") or hasattr(self.adapted, "act"):
            return set()
        rest = _parameters(self._predict)[1:]
        return KEYWORDS & {p.name for p in rest if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)}

    @cached_property
    def _predict(self) -> Callable[..., Any]:
        """What is called on observations."""
        if is_torch_module(self.adapted) and not has_method(self.adapted):
            return module_call(self.adapted)
        return normalized(self.adapted, getattr(self.adapted, "predict", self.adapted))


def clipping_notes(clipped: float, total: float, what: str) -> Iterator[str]:
    """A line that says so if many are clipped."""
    if clipped > MOST_CLIPPED * total:
        yield f"{clipped / total:.0%} of the {what} are clipped: actions are changes in [-1, 1]"


def can_act(target: Any) -> bool:
    """Whether a `UserObject` can be made of an object."""
    return not isinstance(target, type) and (has_method(target) or callable(target))


def has_method(target: Any) -> bool:
    """Whether an object has one of the methods by which it can act."""
    return any(callable(getattr(target, name, None)) for name in METHODS)


def has_needs(target: Any) -> bool:
    """Whether an object says itself what it needs. Raises UsageError for `needs` of another type."""
    needs = getattr(target, "needs", None)
    if needs is not None and not isinstance(needs, Needs):
        found = "a method" if callable(needs) else repr(needs)
        raise UsageError(
            f"{type(target).__name__}.needs: found {found}, expected an attribute or a property that is a "
            "Needs(history, step_draws, episode_draws, memory) of ibdata.policies"
        )
    return needs is not None


def refuse_shared(policy: Policy) -> None:
    """Raise PolicyError for a policy in which an object that remembers acts in two places."""
    parts = [part for part in policy.everywhere() if isinstance(part, UserObject) and part.remembers]
    if len({id(part.adapted) for part in parts}) < len(parts):
        raise PolicyError(
            f"policy {policy.label}: found {parts[0].code_target} in two places, expected an object for "
            "each, because it remembers the episodes in which it acts"
        )


def needs_of(target: Any, history: int = 1, step_draws: int = 0) -> Needs:
    """The needs of an object: its attribute `needs` if it has one, else these."""
    needs: Needs = target.needs if has_needs(target) else Needs(history, step_draws)
    return needs


def _parameters(call: Any) -> list[inspect.Parameter]:
    try:
        return list(inspect.signature(call).parameters.values())
    except (TypeError, ValueError):  # of a function in C
        return []
