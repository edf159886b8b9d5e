"""Call a policy and check that it returns valid actions and log densities."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.errors import IbdataError
from ibdata.policies import Policy
from ibdata.policies.actions import as_numbers, clip_and_round
from ibdata.policies.given import Given
from ibdata.policies.user_code import told
from ibdata.policies.ways import AnswerError


class PolicyError(IbdataError):
    """A policy raised an exception, or returned no valid action or log density."""


class CheckedPolicy(NamedTuple):
    """A policy whose results are checked. A lane is one of the episodes that are simulated side by side."""

    policy: Policy
    label: str
    first: int  # the episode in lane 0
    lanes: int

    def decide(self, given: Given, out: npt.NDArray[np.float32]) -> tuple[int, npt.NDArray[np.float64]]:
        """Write the policy's actions, clipped and rounded, into out (n, 3).

        A policy that sees and remembers nothing may act for several steps at once; n is then the number of
        steps times the number of lanes.

        Returns:
            The number of actions that were clipped, and the memory (n, memory_size) for the next step.

        Raises:
            PolicyError: the policy returned no valid action; the message names policy, episode and step.
        """
        answer = self._asked(lambda: self.policy.decide(given), given, out.shape, "actions")
        return self._taken(answer, given, out)

    def decide_with_density(
        self, given: Given, out: npt.NDArray[np.float32], log_density: npt.NDArray[np.float64]
    ) -> tuple[int, npt.NDArray[np.float64]]:
        """As `decide`, and write the log densities of the actions into log_density (n,)."""
        answer, density = self._asked(
            lambda: self.policy.decide_with_density(given), given, out.shape, "actions"
        )
        taken = self._taken(answer, given, out)
        if density is None:
            log_density[:] = self.log_density(given, out)
        else:
            log_density[:] = self._numbers(density, given, log_density.shape, "log densities")
        return taken

    def _taken(
        self, answer: Any, given: Given, out: npt.NDArray[np.float32]
    ) -> tuple[int, npt.NDArray[np.float64]]:
        """Check a decision, and write its actions."""
        if not (isinstance(answer, tuple) and len(answer) == 2):
            wrong = f"found {type(answer).__name__}, expected a Decision of actions and memory"
            raise PolicyError(f"{self._place(given, 0)}: {wrong}")
        action = self._numbers(answer[0], given, out.shape, "actions")
        memory = given.memory
        if self.policy.memory_size:
            memory = self._numbers(answer[1], given, memory.shape, "memory")
        clipped = int(clip_and_round(action, out))
        if clipped < 0:
            lane = -1 - clipped
            raise PolicyError(
                f"{self._place(given, lane)}: found action {action[lane]}, expected finite numbers"
            )
        return clipped, memory

    def log_density(self, given: Given, action: npt.NDArray[np.float32]) -> npt.NDArray[np.float64]:
        """Return the log density (n,) of the actions. Raises PolicyError if it has the wrong shape."""
        taken = action.view()
        taken.flags.writeable = False
        shape = (len(taken),)
        answer = self._asked(lambda: self.policy.log_density(given, taken), given, shape, "log densities")
        return self._numbers(answer, given, shape, "log densities")

    def _place(self, given: Given, row: int) -> str:
        episode = self.first + row % max(1, self.lanes)
        return f"policy {self.label}: episode {episode}: step {given.step[row] if len(given.step) else 0}"

    def _asked(self, ask: Callable[[], Any], given: Given, shape: tuple[int, ...], what: str) -> Any:
        """Return the result of calling `ask`."""
        try:
            return ask()
        except (IbdataError, KeyboardInterrupt):  # raised by a signal handler, for example
            raise
        except AnswerError as error:
            raise PolicyError(f"{self._place(given, 0)}: {error}") from error
        except BaseException as error:  # a policy must not end the run
            raise PolicyError(f"{self._place(given, 0)}: {told(error)}") from error

    def _numbers(
        self, answer: Any, given: Given, shape: tuple[int, ...], what: str
    ) -> npt.NDArray[np.float64]:
        """Return what a policy answered as an array of that shape."""
        try:
            numbers = as_numbers(answer)
        except (TypeError, ValueError):
            wrong = f"found {repr(answer)[:60]}, expected {what} of shape {shape}"
            raise PolicyError(f"{self._place(given, 0)}: {wrong}") from None
        if numbers.shape != shape:
            wrong = f"found {what} of shape {numbers.shape}, expected {shape}"
            raise PolicyError(f"{self._place(given, 0)}: {wrong}")
        return numbers
