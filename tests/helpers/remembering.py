"""Policies that remember, in each of the ways that ibdata knows."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from ibdata.policies import Decision, Distribution, Needs, Policy

BACK = 0.15


def kicked(x, u):
    return (1.0 - BACK) * x + 0.2 * (2.0 * u - 1.0)


class Deciding(Policy):
    """Drifts by what it remembers in its memory."""

    needs: ClassVar[Needs] = Needs(draws=3, memory=3)

    kind: Literal["deciding"] = "deciding"

    def decide(self, given):
        x = kicked(given.memory, given.draws)
        return Decision(x, x)


class Uniform3(Distribution):
    """Uniform within 0.2 of a centre (n, 3)."""

    draws = 3

    def __init__(self, centre):
        self.centre = centre

    def sample(self, u):
        return self.centre + 0.2 * (2.0 * u - 1.0)

    def log_density(self, action):
        near = (np.abs(action - self.centre) < 0.2).all(axis=1)
        return np.where(near, -3.0 * np.log(0.4), -np.inf)


class Centred(Deciding):
    """Drifts around what it draws for an episode, with a density."""

    needs: ClassVar[Needs] = Needs(draws=3, episode_draws=1, memory=3)
    theta: float = 0.15

    def decide(self, given):
        before = (1.0 - self.theta) * given.memory
        x = before + 0.2 * (2.0 * given.draws - 1.0)
        return Decision(Uniform3(given.episode_draws - 0.5 + before), x)


class Resetting:
    """Drifts by what it keeps, and begins anew."""

    needs = Needs(draws=3)

    def reset(self, n):
        self.x = np.zeros((n, 3))

    def act(self, history, u):
        self.x = kicked(self.x, u)
        return self.x


class Recurrent:
    """Has a state of two arrays (layers, n, hidden), as RecurrentPPO of sb3-contrib."""

    def __init__(self):
        self.calls = []

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        assert deterministic
        self.calls.append((state is None, episode_start.copy()))
        cell, hidden = state or np.full((2, 2, len(observation), 3), 9.0)
        cell, hidden = (np.where(episode_start[:, None], 0.0, x) for x in (cell, hidden))
        cell = 0.9 * cell + 0.001 * observation[:, 1:4]
        hidden = 0.5 * hidden + cell
        return hidden[0] - 0.5, (cell, hidden)
