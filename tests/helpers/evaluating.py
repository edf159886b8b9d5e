"""Returns of policies, lines of baselines, and importance weights of episodes in memory."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from helpers.policies import policy_of
from ibdata import evaluate
from ibdata.errors import UsageError
from ibdata.evaluation.baselines import WHOLE, Baseline, measured
from ibdata.evaluation.importance import of_ratios
from ibdata.evaluation.overlap import Part, Recorded, log_ratios, refuse_remembered_draws
from ibdata.experiment import Experiment
from ibdata.plan.rollout import rollout

# The evaluation of the sets at setpoint 70.
LITERATURE = {"setpoint": 70.0, "start": "default", "dynamics": "siemens", "steps": 100, "discount": 0.97}
LITERATURE |= {"episodes": 200, "seed": 0}
NUDGE = {"kind": "constant", "action": [0.5, -1, 0.25]}
FEW, STEPS = 1000, 3  # of the episodes in memory
BAD = {"kind": "bad"}
NETWORK = {"kind": "network", "file": "p70-3"}
HALF = {"base": BAD, "epsilon": 0.5}
BLOCKS = {
    "random": {"kind": "random"},
    "safe": {"kind": "safe"},
    "bad": BAD,
    "sampled": {"kind": "sampled", "base": NETWORK, "share": 1.0},
    "ε-greedy": {"kind": "epsilon_greedy", **HALF},
    "ε-greedy of expert": {"kind": "epsilon_greedy", "base": {"kind": "expert"}, "epsilon": 0.2},
    "gaussian": {"kind": "gaussian", "base": BAD, "scale": 1.0},
    "ornstein_uhlenbeck": {"kind": "ornstein_uhlenbeck", "sigma": 0.7},
    "unknown": {"kind": "live", "target": lambda seen: seen[:, 1:4] / 100.0},
    "sticky bad": {"kind": "sticky", "base": BAD, "kappa": 0.5},
    "mixture": {"kind": "mixture", "bases": [{"kind": "random"}, {"kind": "safe"}]},
    "schedule": {"kind": "schedule", "stages": [{"base": BAD, "steps": 3, "epsilon": [0.9, 0.2]}]},
}
POLICY = {name: policy_of(block) for name, block in BLOCKS.items()}


def returns(policy, setpoint=70.0, **settings):
    """The returns of a policy in a few short episodes."""
    return evaluate(policy, setpoint, **{"steps": 30, "episodes": 4, **settings}).returns[0]


def baseline(returns: Any, settings: dict[str, Any] = LITERATURE, **run: Any) -> Baseline:
    """The line of a run, given by `set`, `algorithm` and `seed`, with these returns (episodes,) or none."""
    evaluated = measured(settings, None if returns is None else np.atleast_2d(returns))
    return Baseline(
        **{"trained_on": WHOLE, **run},
        evaluations=[evaluated],
        training_steps=1,
        seconds=1.0,
        cpu_seconds=1.0,
        content_root="0" * 64,
        hyperparameters={},
        versions={},
    )


class Data:
    """The episodes of a behaviour in memory."""

    def __init__(self, policy, episodes=FEW, **settings):
        usual = {"name": "x", "setpoints": 70, "episodes": episodes, "steps": STEPS, "start": "uniform"}
        self.experiment = Experiment(**{**usual, **settings}, policies=[policy])
        columns = rollout(self.experiment, 0, episodes)
        by_name = dict(zip(columns.names, columns.table, strict=True))
        shape = (episodes, self.experiment.steps)

        def grid(prefix):
            names = [name for name in columns.names if name.startswith(prefix)]
            return np.stack([by_name[name] for name in names], axis=1).reshape(*shape, -1)

        self.observations, self.actions = (grid(role).astype(np.float32) for role in ("obs_", "act_"))
        self.log_prob, self.rewards = (
            by_name[name].astype(np.float64).reshape(shape) for name in ("action_log_prob", "reward")
        )

    def ratios(self, target, episodes=slice(None)):
        """The logarithms of the ratios, of all episodes or of a slice."""
        if target.form() != self.experiment.policies[0].form():
            refuse_remembered_draws(target)
        numbers = np.arange(len(self.actions))[episodes]
        recorded = Recorded(self.observations[episodes], self.actions[episodes])
        log_prob, rows = self.log_prob[episodes], self.log_prob.size
        part = Part(self.experiment, numbers, numbers)
        return log_ratios(part, part.behaviour, recorded, log_prob, target, rows)

    def importance(self, target, discount=0.97):
        """The estimates."""
        return of_ratios(target.label, self.ratios(target), self.rewards, discount)


@functools.cache
def few(name):
    """A few episodes of a behaviour."""
    return Data(POLICY[name], FEW)


def supported(data, target):
    """Whether the target is not refused; other messages are errors."""
    try:
        data.ratios(target)
    except UsageError as error:
        expected = ("expected data of a policy", "found no log density", "has a memory and random numbers")
        if not any(said in str(error) for said in expected):
            raise
        return False
    return True
