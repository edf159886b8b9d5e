"""Policies of a user that do little, in several of the forms that ibdata takes."""

from __future__ import annotations

import numpy as np

from ibdata.policies import Decision, Deterministic, Policy


def still(observations):
    """Do nothing."""
    return np.zeros((len(observations), 3))


class Mine:
    """Takes the same action always, and counts how often it is asked."""

    def __init__(self, size=0.0):
        self.size, self.asked = size, 0

    def predict(self, observations):
        self.asked += 1
        return np.full((len(observations), 3), self.size)


class Drawing:
    """Takes random actions."""

    def act(self, history, u):
        return 2.0 * u - 1.0


class Still(Policy):
    """Does nothing, and has no density."""

    kind: str = "still"

    def decide(self, given):
        return Decision(still(given.step), given.memory)


class Sure(Still, Deterministic):
    """Says that its action is certain."""

    kind: str = "sure"
