"""Ask a policy about the first step of episodes."""

from __future__ import annotations

import numpy as np

from ibdata.policies.actions import applied
from ibdata.policies.base import at_start
from ibdata.policies.checked import distribution_of


def distribution(policy, observed):
    """The distribution of a policy's action."""
    return distribution_of(policy, observed)[0]


def drawn(policy, observed):
    """The actions that a policy draws, before they are clipped."""
    return np.asarray(distribution(policy, observed).sample(observed.uniforms))


def proposed(policy, history, u=None):
    """What a policy answers to observations (n, history, 6) and random numbers, before it is clipped."""
    return drawn(policy, at_start(history, policy.needs, u))


def action_of(policy, history, u=None):
    """The actions, clipped and rounded."""
    return applied(proposed(policy, history, u))


def log_density_of(policy, history, action):
    """The log densities of actions."""
    return distribution(policy, at_start(history, policy.needs)).log_density(action)
