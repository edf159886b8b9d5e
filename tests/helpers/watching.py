"""A policy that keeps what it sees."""

from __future__ import annotations

from functools import cached_property
from typing import Literal

import numpy as np

from ibdata.policies import Policy


class Watching(Policy):
    """Does nothing, and keeps what it sees. Policies of ibdata are asked once at every step."""

    kind: Literal["watching"] = "watching"
    frames: int = 1

    @property
    def history_length(self):
        return self.frames

    @cached_property
    def seen(self):
        return []

    def act(self, history, u):
        self.seen.append(history.copy())
        return np.zeros((len(history), 3))
