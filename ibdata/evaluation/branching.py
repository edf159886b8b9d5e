"""Branches: episodes that begin in given states, with random numbers of their own."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ibdata.evaluation.play import EvaluationBlock, Floats
from ibdata.experiment import Experiment
from ibdata.experiment.cells import form_digest
from ibdata.numerics.philox import Raw
from ibdata.numerics.random import stream_key
from ibdata.policies import Policy
from ibdata.policies.checked import CheckedPolicy
from ibdata.simulation.episodes import Episodes, Float32s
from ibdata.simulation.replay import Ints, Visited
from ibdata.simulation.rollout import LANES


class Points(NamedTuple):
    """Rows of an experiment from which branches begin."""

    experiment: Experiment
    begun: Visited  # n rows
    keys: tuple[Raw, Raw]  # (n, 2) each: of the environment's and of the policy's random numbers
    first: Float32s | None  # the first actions (n, 3)


def keys(seed: int, experiment: Experiment, policy: Policy, numbers: Ints, times: Ints) -> tuple[Raw, Raw]:
    """The keys of the branches' random numbers, (n, 2) each: of the environment's and of the policy's.

    They are made from the address of the row, so they differ from row to row, and with the label "branch",
    which no cell and no evaluation has. The policy is in the second only.

    Args:
        seed: the seed of the branches.
        experiment: the experiment of the rows.
        policy: the policy that acts.
        numbers: the episodes (n,) in the experiment.
        times: the steps (n,).
    """
    environment, own = [], []
    for number, time in zip(numbers.tolist(), times.tolist(), strict=True):
        cell, index = divmod(number, experiment.episodes)
        digest = experiment.cells[cell].digest.hex()
        form = {"label": "branch", "seed": experiment.seed, "cell": digest, "index": index, "step": time}
        environment.append(stream_key(seed, form_digest(form)))
        own.append(stream_key(seed, form_digest({**form, "policy": policy.form()})))
    return np.array(environment), np.array(own)


def returns(settings: Experiment, policy: Policy, points: Points, discount: float) -> Floats:
    """Simulate the branches of some rows.

    Args:
        settings: an experiment of which only the steps and the episodes, the branches of each row, count.
        policy: the policy that acts.
        points: the n rows.
        discount: the discount factor.

    Returns:
        The discounted returns (n, episodes).

    Raises:
        PolicyError: the policy failed, or returned no valid action.
    """
    n, total = settings.episodes, len(points.begun.history) * settings.episodes
    out = np.empty(total)
    for start in range(0, total, LANES):
        lanes = np.arange(start, min(start + LANES, total))
        out[lanes] = BranchBlock(settings, policy, points, *np.divmod(lanes, n)).returns(discount)[0]
    return out.reshape(-1, n)


class BranchBlock(EvaluationBlock):
    """Branches side by side. A branch has a row, by its place among the points, and an index."""

    def __init__(
        self, settings: Experiment, policy: Policy, points: Points, rows: Ints, indices: Ints
    ) -> None:
        source, n = points.experiment, len(rows)
        self.experiment, self.n, self.lanes, self.indices = settings, n, np.arange(n), indices
        self.policy = policy
        self.checked = _Checked(policy, f"{policy.label} in a branch", int(rows[0]), n)
        self.checked.first_actions = None if points.first is None else points.first[rows]
        self.keys, self.policy_keys = (own[rows] for own in points.keys)
        self.episodes = Episodes.of(source.start, source.drifting, source.variant)
        self.state, self.history = points.begun.take(rows)


class _Checked(CheckedPolicy):
    """A policy whose first actions may be given."""

    first_actions: Float32s | None = None

    def act(self, seen: Float32s, u: Floats, out: Float32s, t: int) -> int:
        clipped = super().act(seen, u, out, t)
        if t == 0 and self.first_actions is not None:
            out[: self.lanes] = self.first_actions
        return clipped
