"""What a policy returns, checked: actions, memory and log densities."""

from __future__ import annotations

import sys
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.errors import IbdataError, PolicyError, excerpt
from ibdata.policies.actions import WHOLE, clip_and_round, is_discrete, of_discrete
from ibdata.policies.base import Float32s, Floats, Observed, Policy
from ibdata.policies.code import error_line

Ints = npt.NDArray[np.int64]


class AnswerError(Exception):
    """A policy returned no valid answer, or the code of a user failed. The message names no place."""


def actions(answer: Any, n: int) -> Floats:
    """The actions (n, 3) of an answer, which may also be the discrete ones (n,) of the environment."""
    answer = _plain(answer)
    with suppress(TypeError, ValueError):  # what is no array is refused below
        whole = np.asarray(answer)
        if is_discrete(whole) and len(whole) == n:
            answer = of_discrete(whole)
            if answer is None:
                raise AnswerError(f"found {excerpt(whole.tolist())}, expected discrete actions {WHOLE}")
    return numbers(answer, (n, 3), "actions")


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
    answer = _plain(answer)
    try:
        if np.iscomplexobj(answer):
            raise TypeError
        found = np.asarray(answer, dtype=np.float64)
    except (TypeError, ValueError):
        raise AnswerError(f"found {excerpt(answer)}, expected {what} of shape {shape}") from None
    if found.shape != shape:
        shown = excerpt(answer) if found.ndim == 0 else f"{what} of shape {found.shape}"
        raise AnswerError(f"found {shown}, expected {what} of shape {shape}")
    return found


def actions_and_memory(answer: Any) -> tuple[Any, Any]:
    """The two parts of a `Decision`."""
    if not (isinstance(answer, tuple) and len(answer) == 2):
        raise AnswerError(f"found {type(answer).__name__}, expected a Decision of actions and memory")
    return answer


class Checked(NamedTuple):
    """A policy whose answers about n episodes are checked.

    A policy that sees and remembers nothing may act for several steps at once; the rows are then those of all
    episodes at one step after another.
    """

    policy: Policy
    label: str
    episodes: Ints  # their numbers (n,), for messages; none (0,) if they are made up

    def decide(self, given: Observed, out: Float32s, log_density: Floats | None = None) -> tuple[int, Floats]:
        """Write the policy's actions, clipped and rounded, into out (n, 3), and their log densities (n,).

        Returns:
            The number of actions that were clipped, and the memory (n, memory) for the next step.

        Raises:
            PolicyError: the policy returned no valid action; the message names policy, episode and step.
        """
        density = None
        try:
            if log_density is None:
                decision = self.policy.decide(given)
            else:
                decision, density = self.policy.decide_with_density(given)
            proposed, memory = actions_and_memory(decision)
            proposed = actions(proposed, len(out))
            memory = numbers(memory, given.memory.shape, "memory") if given.memory.size else given.memory
            if log_density is not None and density is not None:
                log_density[:] = numbers(density, log_density.shape, "log densities")
        except (IbdataError, KeyboardInterrupt):
            raise
        except BaseException as error:  # a policy must not end the run
            raise self._located(error, given) from error
        clipped = int(clip_and_round(proposed, out))
        if clipped < 0:
            row = -1 - clipped
            raise PolicyError(
                f"{self._place(given, row)}: found action {proposed[row]}, expected finite numbers"
            )
        if log_density is not None and density is None:
            log_density[:] = self.log_density(given, out)
        return clipped, memory

    def log_density(self, given: Observed, action: Float32s) -> Floats:
        """The log density (n,) of the actions. Raises PolicyError if it has the wrong shape."""
        fixed = action.view()
        fixed.flags.writeable = False
        try:
            return numbers(self.policy.log_density(given, fixed), (len(action),), "log densities")
        except (IbdataError, KeyboardInterrupt):
            raise
        except BaseException as error:
            raise self._located(error, given) from error

    def _located(self, error: BaseException, given: Observed) -> PolicyError:
        """An error of the policy as one line with its place."""
        line = str(error) if isinstance(error, AnswerError) else error_line(error)
        return PolicyError(f"{self._place(given)}: {line}")

    def _place(self, given: Observed, row: int = 0) -> str:
        numbers = self.episodes
        where = (
            f"episode {numbers[row % len(numbers)]}" if len(numbers) else "asked about random observations"
        )
        return f"policy {self.label}: {where}: step {given.step[row] if len(given.step) else 0}"
