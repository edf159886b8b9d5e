"""A policy that keeps what it sees."""

from __future__ import annotations

from functools import cached_property
from typing import Literal

import numpy as np

from ibdata.policies import Decision, Needs, Policy


class Watching(Policy):
    """Does nothing, and keeps what it sees. It is also asked before a run, with other numbers of episodes."""

    kind: Literal["watching"] = "watching"
    frames: int = 1

    @property
    def needs(self):
        return Needs(history=self.frames)

    @cached_property
    def seen(self):
        return []

    def decide(self, given):
        self.seen.append(given.observations.copy())
        return Decision(np.zeros((len(given.step), 3)), given.memory)
