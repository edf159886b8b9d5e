"""Branches: episodes that begin in given states, with random numbers of their own."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ibdata.evaluation.play import Floats, returns_of
from ibdata.experiment import Experiment
from ibdata.experiment.cells import form_digest
from ibdata.numerics.philox import Raw
from ibdata.numerics.random import stream_key
from ibdata.policies import Policy
from ibdata.policies.custom import without_runs
from ibdata.simulation.driver import LANES, Lanes, Run, Situation
from ibdata.simulation.world import Float32s, Ints, World


class Points(NamedTuple):
    """n rows from which branches begin."""

    world: World  # with as many steps as the branches have
    policy: Policy  # which acts in the branches
    episodes: Ints  # (n,), counted in the dataset
    steps: Ints  # (n,)
    begun: Situation
    keys: tuple[Raw, Raw]  # (n, 2) each: of the environment's and of the policy's random numbers
    first: Float32s | None  # the first actions (n, 3), or None if the policy chooses them


def keys(seed: int, experiment: Experiment, policy: Policy, numbers: Ints, steps: Ints) -> tuple[Raw, Raw]:
    """The keys of the random numbers of the environment and of the policy in branches, (n, 2) each.

    They are made from the address of the row, its episode in the experiment and its step, and with the label
    "branch", which no cell and no evaluation has. The policy is in the second only.
    """
    environment, own, own_form = [], [], without_runs(policy.form())
    for number, step in zip(numbers.tolist(), steps.tolist(), strict=True):
        cell, index = divmod(number, experiment.episodes)
        digest = experiment.cells[cell].digest.hex()
        form = {"label": "branch", "seed": experiment.seed, "cell": digest, "index": index, "step": step}
        environment.append(stream_key(seed, form_digest(form)))
        own.append(stream_key(seed, form_digest({**form, "policy": own_form})))
    return np.array(environment), np.array(own)


def returns(points: Points, branches: int, discount: float) -> Floats:
    """The discounted returns (n, branches) of branches from each row; PolicyError if the policy fails."""
    total = len(points.steps) * branches
    out = np.empty(total)
    for start in range(0, total, LANES):
        lanes = np.arange(start, min(start + LANES, total))
        out[lanes] = _block(points, *np.divmod(lanes, branches), discount)
    return out.reshape(-1, branches)


def _block(points: Points, rows: Ints, indices: Ints, discount: float) -> Floats:
    """The returns (m,) of branches side by side, each given by the place of its row and by an index."""
    begun = points.begun.take(rows)
    keys, policy_keys = (own[rows] for own in points.keys)
    setpoints, numbers = begun.state.setpoint, points.episodes[rows]
    lanes = Lanes(points.policy, keys, policy_keys, indices, setpoints, points.policy.label, numbers)
    run = Run(points.world, lanes, begun, points.steps[rows])
    return returns_of(run, discount, first_actions=None if points.first is None else points.first[rows])[0]
