"""Branches: episodes that begin in the states of rows, with random numbers of their own."""

from __future__ import annotations

import numpy as np

from ibdata.evaluation.play import Floats, returns_of
from ibdata.experiment import Experiment
from ibdata.experiment.scenario import form_digest
from ibdata.numerics.random import Raw, stream_key
from ibdata.policies import Policy
from ibdata.policies.live import without_runs
from ibdata.simulation.carry import Carry
from ibdata.simulation.episodes import Episodes, Float32s, Ints
from ibdata.simulation.unroll import LANES, unroll
from ibdata.simulation.variables import record_rows


def branches_at(
    seed: int, experiment: Experiment, policy: Policy, numbers: Ints, steps: Ints, shown: Ints, carry: Carry
) -> Episodes:
    """Episodes in which a policy acts from rows (n,) on, each with random numbers of its own.

    Their addresses are made from that of the row, its episode in the experiment and its step, and with the
    label "branch", which no cell and no evaluation has. The policy is in its own addresses only.
    """
    keys: list[Raw] = []
    policy_keys: list[Raw] = []
    for number, step in zip(numbers.tolist(), steps.tolist(), strict=True):
        cell, index = divmod(number, experiment.episodes)
        digest = experiment.cells[cell].digest.hex()
        form = {"label": "branch", "seed": experiment.seed, "cell": digest, "index": index, "step": step}
        keys.append(stream_key(seed, form_digest(form)))
        policy_keys.append(stream_key(seed, form_digest({**form, "policy": without_runs(policy.form())})))
    return Episodes(
        experiment.scenario.world,
        policy,
        policy.label,
        np.array(keys),
        np.array(policy_keys),
        np.zeros_like(numbers),
        carry.state.setpoint,
        shown,
    )


def branch_returns(
    episodes: Episodes,
    carry: Carry,
    first_step: Ints,
    first_actions: Float32s | None,
    *,
    steps: int,
    branches: int,
    discount: float,
) -> Floats:
    """The discounted returns (n, branches) of branches of so many steps.

    Args:
        episodes: an episode for each row (n,); its branches differ in their index.
        carry: where they are.
        first_step: the steps (n,) at which they are.
        first_actions: the first actions (n, 3), or None if the policy chooses them.
        steps: the number of steps of a branch.
        branches: the number of branches of each row.
        discount: the discount factor.

    Raises:
        PolicyError: the policy failed.
    """
    total = len(episodes) * branches
    out = np.empty(total)
    for start in range(0, total, LANES):
        lanes = np.arange(start, min(start + LANES, total))
        row, index = np.divmod(lanes, branches)
        blocks = unroll(
            episodes.take(row, index=index),
            carry.take(row),
            record_rows(["reward"]),
            steps,
            first_step=first_step[row],
            recorded=None if first_actions is None else first_actions[row][None],
        )
        out[lanes], _, _ = returns_of(blocks, discount)
    return out.reshape(-1, branches)
