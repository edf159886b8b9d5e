"""Policies of every kind, asked and played alone."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from ibdata.policies import POLICIES, Observed, Policy
from ibdata.policies.base import at_start
from ibdata.policies.checked import ask
from ibdata.policies.code import Acting
from ibdata.policies.distributions import applied

Actions = npt.NDArray[np.float32]
BAD, SAFE, RANDOM = {"kind": "bad"}, {"kind": "safe"}, {"kind": "random"}
BASE = {"kind": "constant", "action": [0.5, -1.0, 0.1]}
CODE = {"kind": "custom", "target": "ibdata.policies.baselines:Safe", "draws": 5}  # code that everyone has
SURE = {"kind": "custom", "target": "ibdata.policies.baselines:Mediocre", "deterministic": True}
NETWORK = {"kind": "network", "file": "actor.safetensors"}  # see `networks.actor`
NOISE = {"kind": "ornstein_uhlenbeck", "base": BASE, "theta": 0.5, "sigma": 0.6}
STICKY = {"kind": "sticky", "base": SAFE, "kappa": 0.4}
PLAIN = ["bad", "constant", "expert", "mediocre", "multisine", "optimized", "ornstein_uhlenbeck", "prbs"]
BLOCKS = [
    *({"kind": kind} for kind in [*PLAIN, "random", "safe"]),
    BASE,
    {"kind": "prbs", "order": 3, "hold": 1, "amplitude": 0.25},
    {"kind": "multisine", "sines": 2, "period": 16, "amplitude": 0.5},
    CODE,
    SURE,
    NETWORK,
    {"kind": "sampled", "base": NETWORK, "share": 0.4},
    {"kind": "sampled", "base": NETWORK, "share": 1.0},
    {"kind": "gaussian", "base": BASE, "scale": 0.6},
    {"kind": "gaussian", "base": SURE, "scale": 0.4},
    NOISE,
    {"kind": "epsilon_greedy", "base": BASE, "epsilon": 0.3},
    {"kind": "epsilon_greedy", "base": SAFE, "epsilon": 0.3},
    {"kind": "epsilon_greedy", "base": BASE, "epsilon": 1.0},
    {"kind": "epsilon_greedy", "base": SAFE, "epsilon": 0.0},
    {"kind": "epsilon_greedy", "base": SURE, "epsilon": 0.4},
    STICKY,
    {"kind": "sticky", "base": SURE, "kappa": 0.5},
    {"kind": "sticky", "base": {"kind": "epsilon_greedy", "base": BASE, "epsilon": 0.5}, "kappa": 0.4},
    {"kind": "sticky", "base": STICKY, "kappa": 0.5},
    {"kind": "mixture", "bases": [SAFE, BAD, RANDOM]},
    {"kind": "mixture", "bases": [BAD, {"kind": "sticky", "base": NOISE, "kappa": 0.5}]},
    {"kind": "mixture", "bases": [{"kind": "multisine"}, {"kind": "prbs"}], "weights": [1.0, 3.0]},
    {"kind": "schedule", "stages": [{"base": BASE, "steps": 10, "epsilon": [0.9, 0.1]}]},
    {"kind": "schedule", "stages": [{"base": STICKY, "steps": 10, "epsilon": [0.5, 0.5]}]},
    {"kind": "schedule", "stages": [{"base": BAD, "steps": 2}, {"base": SAFE}]},
]


def ready(policy):
    """A copy of a policy whose objects are loaded."""
    with Acting() as acting:
        return policy.loaded(acting)


def policy_of(block):
    """The policy of a block, whose objects are loaded."""
    return ready(POLICIES[block["kind"]](**block))


def distribution(policy, observed):
    """The distribution of a policy's action."""
    return ask(policy, observed)[0]


def drawn(policy, observed):
    """The actions that a policy draws, before they are clipped."""
    return np.asarray(distribution(policy, observed).sample(observed.draws))


def proposed(policy, history, u=None):
    """What a policy answers to observations (n, history, 6) and random numbers, before it is clipped."""
    return drawn(policy, at_start(history, policy.needs, u))


def action_of(policy, history, u=None):
    """The actions, clipped and rounded."""
    return applied(proposed(policy, history, u))


def log_density_of(policy, history, action):
    """The log densities of actions."""
    return distribution(policy, at_start(history, policy.needs)).log_density(action)


def playing(policy: Policy, n: int, steps: int, seed: int = 0) -> Iterator[tuple[Observed, Actions]]:
    """Yield what a policy is given at each step of n episodes, and its actions as they are applied."""
    random, frames = np.random.default_rng(seed), policy.needs.history
    seen = random.uniform(0.0, 100.0, (n, frames, 6)).astype(np.float32)
    done, memory = np.zeros((n, frames, 3), dtype=np.float32), np.zeros((n, policy.needs.memory))
    drawn = random.random((n, policy.needs.episode_draws))
    for t in range(steps):
        u = random.random((n, policy.needs.draws))
        observed = Observed(seen, done, np.full(n, t), u, drawn, memory)
        distribution, memory = ask(policy, observed)
        actions = np.clip(np.asarray(distribution.sample(u)), -1.0, 1.0).astype(np.float32)
        yield observed, actions
        done = np.concatenate([actions[:, None], done], axis=1)[:, :frames]
        now = random.uniform(0.0, 100.0, (n, 1, 6)).astype(np.float32)
        seen = np.concatenate([now, seen], axis=1)[:, :frames]


def played(policy: Policy, n: int, steps: int, seed: int = 0) -> Actions:
    """The actions (n, steps, 3)."""
    return np.stack([actions for _, actions in playing(policy, n, steps, seed)], axis=1)
