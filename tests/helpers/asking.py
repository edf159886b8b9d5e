"""Ask a policy about the first step of episodes."""

from __future__ import annotations

import numpy as np

from ibdata.policies.actions import applied
from ibdata.policies.base import at_start


def proposed(policy, history, u=None):
    """What a policy answers to observations (n, history, 6) and random numbers, before it is clipped."""
    return np.asarray(policy.decide(at_start(history, policy.needs, u)).actions)


def action_of(policy, history, u=None):
    """The actions, clipped and rounded."""
    return applied(proposed(policy, history, u))


def log_density_of(policy, history, action):
    """The log densities of actions."""
    return policy.log_density(at_start(history, policy.needs), action)
