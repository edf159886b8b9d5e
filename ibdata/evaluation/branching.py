"""Branches: episodes that begin in given states, with random numbers of their own."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ibdata.evaluation.play import EvaluationBlock, Floats
from ibdata.experiment import Experiment
from ibdata.experiment.cells import form_digest
from ibdata.numerics.philox import Raw
from ibdata.numerics.random import stream_key
from ibdata.policies import Policy
from ibdata.policies.given import Given
from ibdata.simulation.episodes import Float32s
from ibdata.simulation.revisit import Ints, Visited, Watching
from ibdata.simulation.rollout import LANES


class Points(NamedTuple):
    """n rows from which branches begin."""

    experiment: Experiment  # of the rows, with as many steps as the branches have
    policy: Policy  # which acts in the branches
    episodes: Ints  # (n,), counted in the dataset
    steps: Ints  # (n,)
    begun: Visited
    keys: tuple[Raw, Raw]  # (n, 2) each: of the environment's and of the policy's random numbers
    first: Float32s | None  # the first actions (n, 3), or None if the policy chooses them


def keys(seed: int, experiment: Experiment, policy: Policy, numbers: Ints, steps: Ints) -> tuple[Raw, Raw]:
    """The keys of the branches' random numbers, (n, 2) each: of the environment's and of the policy's.

    They are made from the address of the row, so they differ from row to row, and with the label "branch",
    which no cell and no evaluation has. The policy is in the second only.

    Args:
        seed: the seed of the branches.
        experiment: the experiment of the rows.
        policy: the policy that acts.
        numbers: the episodes (n,), counted in the experiment.
        steps: the steps (n,).
    """
    environment, own = [], []
    for number, step in zip(numbers.tolist(), steps.tolist(), strict=True):
        cell, index = divmod(number, experiment.episodes)
        digest = experiment.cells[cell].digest.hex()
        form = {"label": "branch", "seed": experiment.seed, "cell": digest, "index": index, "step": step}
        environment.append(stream_key(seed, form_digest(form)))
        own.append(stream_key(seed, form_digest({**form, "policy": policy.form()})))
    return np.array(environment), np.array(own)


def returns(points: Points, branches: int, discount: float) -> Floats:
    """The discounted returns (n, branches) of branches from each row; PolicyError if the policy fails."""
    total = len(points.steps) * branches
    out = np.empty(total)
    for start in range(0, total, LANES):
        lanes = np.arange(start, min(start + LANES, total))
        out[lanes] = BranchBlock(points, *np.divmod(lanes, branches)).returns(discount)[0]
    return out.reshape(-1, branches)


class BranchBlock(EvaluationBlock):
    """Branches side by side, each given by the place of its row and by an index."""

    def __init__(self, points: Points, rows: Ints, indices: Ints) -> None:
        watching = _Acting.of(points.policy, points.episodes[rows])
        watching.first_actions = None if points.first is None else points.first[rows]
        self._address(points.experiment, watching, indices, *(own[rows] for own in points.keys))
        self.state, self.past, self.memory, self.drawn = points.begun.take(rows)
        self.steps = points.steps[rows]

    def questions(self, t: int, count: int, span: int) -> Iterator[Given]:
        """As of every block, with the steps of the episodes from which the branches come."""
        for given in super().questions(t, count, span):
            yield given._replace(step=given.step + np.tile(self.steps, span))


class _Acting(Watching):
    """A policy that acts, but whose first actions may be given."""

    first_actions: Float32s | None

    def decide(self, given: Given, out: Float32s) -> tuple[int, Floats]:
        answer = super().decide(given, out)
        if self.first_actions is not None:
            out[: self.lanes], self.first_actions = self.first_actions, None
        return answer
