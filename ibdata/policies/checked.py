"""Call a policy and check that it returns valid actions and log densities."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.errors import IbdataError
from ibdata.policies import Policy
from ibdata.policies.actions import as_numbers, clip_and_round
from ibdata.policies.adapter import AnswerError
from ibdata.policies.user_code import told


class PolicyError(IbdataError):
    """A policy raised an exception, or returned no valid action or log density."""


class CheckedPolicy(NamedTuple):
    """A policy whose results are checked. A lane is one of the episodes that are simulated side by side."""

    policy: Policy
    label: str
    first: int  # the episode in lane 0
    lanes: int

    def act(
        self, seen: npt.NDArray[np.float32], u: npt.NDArray[np.float64], out: npt.NDArray[np.float32], t: int
    ) -> int:
        """Write the policy's actions, clipped and rounded, into out (n, 3).

        A policy that sees no observations may act for several steps at once, from step t on; n is then the
        number of steps times the number of lanes.

        Returns:
            The number of actions that were clipped.

        Raises:
            PolicyError: the policy returned no valid action; the message names policy, episode and step.
        """
        action = self._answer(lambda: self.policy.act(seen, u), out.shape, "actions", t)
        clipped = int(clip_and_round(action, out))
        if clipped < 0:
            lane = -1 - clipped
            place = self._place(t + lane // self.lanes, self.first + lane % self.lanes)
            raise PolicyError(f"{place}: found action {action[lane]}, expected finite numbers")
        return clipped

    def log_prob(
        self, seen: npt.NDArray[np.float32], action: npt.NDArray[np.float32], t: int
    ) -> npt.NDArray[np.float64]:
        """Return the log density (n,) of the actions. Raises PolicyError if it has the wrong shape."""
        taken = action.view()
        taken.flags.writeable = False
        return self._answer(lambda: self.policy.log_prob(seen, taken), (len(taken),), "log densities", t)

    def _place(self, t: int, episode: int) -> str:
        return f"policy {self.label}: episode {episode}: step {t}"

    def _answer(
        self, ask: Callable[[], npt.ArrayLike], shape: tuple[int, ...], what: str, t: int
    ) -> npt.NDArray[np.float64]:
        """Return the result of calling `ask`, as an array of that shape."""
        place = self._place(t, self.first)
        try:
            given = ask()
        except IbdataError:  # raised by a signal handler, for example
            raise
        except AnswerError as error:
            raise PolicyError(f"{place}: {error}") from error
        except (Exception, SystemExit) as error:  # a policy must not end the run
            raise PolicyError(f"{place}: {told(error)}") from error
        try:
            answer = as_numbers(given)
        except (TypeError, ValueError):
            wrong = f"found {repr(given)[:60]}, expected {what} of shape {shape}"
            raise PolicyError(f"{place}: {wrong}") from None
        if answer.shape != shape:
            raise PolicyError(f"{place}: found {what} of shape {answer.shape}, expected {shape}")
        return answer
