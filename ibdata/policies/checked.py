"""What a policy answers, checked: its actions, its memory and what its distributions say."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from ibdata.errors import IbdataError, PolicyError, excerpt
from ibdata.policies.actions import WHOLE, clip_and_round, is_discrete, of_discrete, read_only
from ibdata.policies.base import Float32s, Floats, Observed, Policy, is_deterministic
from ibdata.policies.code import error_line
from ibdata.policies.distributions import Bools, Certain, Distribution, Unknown

Ints = npt.NDArray[np.int64]
T = TypeVar("T")


class AnswerError(Exception):
    """A policy returned no valid answer, or the code of a user failed. The message names no place."""


def actions(answer: Any, n: int) -> Floats:
    """The actions (n, 3) of an answer, which may also be the discrete ones (n,) of the environment."""
    if _is_plain(answer, (n, 3)):
        return np.asarray(answer)
    answer = _plain(answer)
    with suppress(TypeError, ValueError):  # what is no array is refused below
        whole = np.asarray(answer)
        if is_discrete(whole) and len(whole) == n:
            answer = of_discrete(whole)
            if answer is None:
                raise AnswerError(f"found {excerpt(whole.tolist())}, expected discrete actions {WHOLE}")
    return numbers(answer, (n, 3), "actions")


def _is_plain(answer: Any, shape: tuple[int, ...]) -> bool:
    """Whether an answer is an array of that shape and nothing else, as those of ibdata's own policies are."""
    return type(answer) is np.ndarray and answer.dtype == np.float64 and answer.shape == shape


def _plain(answer: Any) -> Any:
    """A tensor of torch, or an array with masked values, as an array; anything else as it is."""
    tensor: Any = getattr(sys.modules.get("torch"), "Tensor", ())
    if isinstance(answer, tensor):
        answer = (answer.double() if answer.is_floating_point() else answer).numpy(force=True)
    if isinstance(answer, np.ma.MaskedArray):
        answer = np.ma.filled(answer.astype(np.float64), np.nan)
    return answer


def numbers(answer: Any, shape: tuple[int, ...], what: str) -> Floats:
    """An answer as an array of that shape, also a tensor of torch; masked values are NaN."""
    if _is_plain(answer, shape):
        return np.asarray(answer)
    answer = _plain(answer)
    try:
        if np.iscomplexobj(answer):
            raise TypeError
        array = np.asarray(answer, dtype=np.float64)
    except (TypeError, ValueError):
        raise AnswerError(f"found {excerpt(answer)}, expected {what} of shape {shape}") from None
    if array.shape != shape:
        shown = excerpt(answer) if array.ndim == 0 else f"{what} of shape {array.shape}"
        raise AnswerError(f"found {shown}, expected {what} of shape {shape}")
    return array


def decision(answer: Any) -> tuple[Any, Any]:
    """The two parts of a `Decision`. Raises AnswerError if the answer is none."""
    if not (isinstance(answer, tuple) and len(answer) == 2):
        expected = "a Decision of a distribution or actions, and memory"
        raise AnswerError(f"found {type(answer).__name__}, expected {expected}")
    return answer


class OfUser(Distribution):
    """A distribution of a user's class, whose answers are checked. It cannot change the actions it is given.

    All methods raise AnswerError for what is no answer; errors of the user's code are passed on.
    """

    def __init__(self, distribution: Distribution) -> None:
        self.distribution, self.draws = distribution, distribution.draws

    def sample(self, u: Floats) -> Floats:
        actions = self.distribution.sample(np.ascontiguousarray(u[:, : self.draws]))
        return numbers(actions, (len(u), 3), "actions")

    def log_density(self, action: Float32s) -> Floats:
        density = numbers(self.distribution.log_density(read_only(action)), action.shape[:1], "log densities")
        if (density == np.inf).any():
            raise AnswerError(f"found the log density inf at {action[density == np.inf][0]}, expected less")
        return density

    def atoms(self, action: Float32s) -> Bools:
        atoms = np.asarray(self.distribution.atoms(read_only(action)))
        if atoms.dtype != np.bool_ or atoms.shape != action.shape:
            shape_found, expected = (
                f"atoms of {atoms.dtype} and shape {atoms.shape}",
                f"bool and {action.shape}",
            )
            raise AnswerError(f"found {shape_found}, expected {expected}")
        return atoms


def distribution_of(policy: Policy, observed: Observed) -> tuple[Distribution, Any]:
    """The distribution of a policy's action, and its memory (n, memory).

    Plain actions are certain if the policy is deterministic, else their density is unknown. Raises
    AnswerError for what is no `Decision`, and for a distribution that takes more random numbers than the
    policy needs.
    """
    action, memory = decision(policy.decide(observed))
    if not isinstance(action, Distribution):
        plain = actions(action, len(observed.step))
        return (Certain if is_deterministic(policy) else Unknown)(plain), memory
    if action.draws > observed.uniforms.shape[1]:
        raise AnswerError(
            f"found a {type(action).__name__} and needs.step_draws {observed.uniforms.shape[1]}, expected at "
            f"least {action.draws}, the random numbers that it takes"
        )
    is_own = type(action).__module__.startswith("ibdata.")
    return (action if is_own else OfUser(action)), memory


class CheckedPolicy(NamedTuple):
    """A policy whose answers about n episodes are checked.

    A policy that sees and remembers nothing may act for several steps at once; the rows are then those of all
    episodes at one step after another.
    """

    policy: Policy
    label: str
    episodes: Ints  # their numbers (n,), for messages; none (0,) if they are made up

    def act(self, observed: Observed, out: Float32s, log_density: Floats | None = None) -> tuple[int, Floats]:
        """Write the policy's actions, clipped and rounded, into out (n, 3), and their log densities (n,).

        Returns:
            The number of actions that were clipped, and the memory (n, memory) for the next step.

        Raises:
            PolicyError: the policy returned no valid action; the message names policy, episode and step.
        """

        def play(distribution: Distribution) -> int:
            proposed = numbers(distribution.sample(observed.uniforms), out.shape, "actions")
            clipped = int(clip_and_round(proposed, out))
            if clipped < 0:
                row = -1 - clipped
                problem = f"found action {proposed[row]}, expected finite numbers"
                raise PolicyError(f"{self._place(observed, row)}: {problem}")
            if isinstance(distribution, Certain) and log_density is not None:
                log_density[:] = 0.0  # of an action that it is certain of
            elif log_density is not None:
                log_density[:] = distribution.log_density(out)
            return clipped

        return self.ask(observed, play)

    def ask(self, observed: Observed, question: Callable[[Distribution], T]) -> tuple[T, Floats]:
        """The answer to a question about the policy's distribution, and the memory. Raises PolicyError."""
        try:
            distribution, memory = self.distribution(observed)
            return question(distribution), memory
        except (IbdataError, KeyboardInterrupt):
            raise
        except BaseException as error:
            raise self._located(error, observed) from error

    def distribution(self, observed: Observed) -> tuple[Distribution, Floats]:
        """The distribution of the policy's action, and the memory (n, memory). Raises what goes wrong."""
        distribution, memory = distribution_of(self.policy, observed)
        if not observed.memory.size:
            return distribution, observed.memory
        return distribution, numbers(memory, observed.memory.shape, "memory")

    def _located(self, error: BaseException, observed: Observed) -> PolicyError:
        """An error of the policy, which must not end the run, as one line with its place."""
        line = str(error) if isinstance(error, AnswerError) else error_line(error)
        return PolicyError(f"{self._place(observed)}: {line}")

    def _place(self, observed: Observed, row: int = 0) -> str:
        numbers = self.episodes
        where = (
            f"episode {numbers[row % len(numbers)]}" if len(numbers) else "asked about random observations"
        )
        step = observed.step[row] if len(observed.step) else 0
        return f"policy {self.label}: {where}: step {step}"
