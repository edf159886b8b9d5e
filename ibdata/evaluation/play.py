"""Play episodes of policies, with the same random numbers of the environment for all of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ibdata._numerics.arrays import Floats, Ints
from ibdata._numerics.random import stream_key
from ibdata._simulation.carry import Carry, begin
from ibdata._simulation.episodes import Episodes, observed_rows, record_rows, values_of
from ibdata._simulation.unroll import LANES, Block, unroll
from ibdata._system.progress import Advance, unseen
from ibdata.errors import UsageError
from ibdata.evaluation.policies import burn_in_notes, loaded, notes_on, setpoint_notes
from ibdata.experiment.scenario import Cell, Scenario, form_digest
from ibdata.policies import Observed
from ibdata.policies.distributions import read_only
from ibdata.policies.user_object import ObjectPolicy
from ibdata.views.options import PLAIN, ViewOptions, Window
from ibdata.views.rewards import PAID_BY, scaled
from ibdata.views.variables import variable_of

RETURN_BYTES = 16  # least memory per episode, for two sums


class Played(NamedTuple):
    """What policies got, (policies, setpoints, episodes) unless it says otherwise."""

    discounted: Floats  # returns
    undiscounted: Floats  # returns
    costs: Floats  # cost returns, undiscounted; zero for a view without a cost
    clipped: Floats  # the share of actions that were clipped, (policies, setpoints)
    notes: list[list[str]]  # on each policy


def checked_discount(discount: float) -> float:
    """The discount factor as a float. Raises UsageError if it is not in [0, 1]."""
    if not 0 <= discount <= 1:
        raise UsageError(f"discount: found {discount}, expected a number in [0, 1]")
    return float(discount)


def play(
    scenario: Scenario,
    cells: Sequence[Cell],
    discount: float,
    advance: Advance = unseen,
    view: ViewOptions = PLAIN,
) -> Played:
    """Play the episodes of a scenario's cells, which come by policy and then by setpoint.

    The view says what users' objects see, and what is rewarded. Raises PolicyError if a policy fails.
    """
    per_policy, n = len(scenario.points), scenario.episodes
    out, clipped = np.empty((3, len(cells), n)), np.zeros(len(cells))
    columns, rows, notes = len(view.frame(scenario.drifting)), record_rows(rewarded(view)), []
    for first_cell in range(0, len(cells), per_policy):
        those = slice(first_cell, first_cell + per_policy)
        alone = [cells[first_cell].policy]  # one at a time, so that their modules never meet
        with loaded(alone, columns, says=False) as [policy]:
            at_setpoints = list(setpoint_notes(policy, scenario, view))  # which ask it, before it acts
            for number in range(those.start, those.stop):
                cell = dataclasses.replace(cells[number], policy=policy)
                for first in range(0, n, LANES):
                    part = slice(first, min(first + LANES, n))
                    episodes = _paired(scenario, cell, number, np.arange(part.start, part.stop))
                    carry = begin(episodes, observed_rows(view, scenario.drifting))
                    observe = _through(view, episodes, carry)
                    blocks = unroll(episodes, carry, rows, scenario.steps, observe=observe)
                    *returns, count = returns_of(blocks, discount, advance, view)
                    out[0, number, part], out[1, number, part], out[2, number, part] = returns
                    clipped[number] += count / (n * scenario.steps)
            notes.append([*notes_on(policy, view), *at_setpoints, *burn_in_notes(policy, scenario)])
    discounted, undiscounted, costs = out.reshape(3, -1, per_policy, n)
    return Played(discounted, undiscounted, costs, clipped.reshape(-1, per_policy), notes)


def rewarded(view: ViewOptions) -> list[str]:
    """The variables of which rewards are made, and then those of which costs are made."""
    rewards = ["reward"] if view.reward.kind == "classic" else list(PAID_BY)
    return [*rewards, *(map(variable_of, view.cost.variables) if view.cost else [])]


class Returns(NamedTuple):
    """The returns (n,) of some episodes, and how many of their actions were clipped."""

    discounted: Floats
    undiscounted: Floats
    costs: Floats
    clipped: int


def returns_of(
    blocks: Iterable[Block], discount: float, advance: Advance = unseen, view: ViewOptions = PLAIN
) -> Returns:
    """The returns of episodes. The blocks record what is `rewarded` by the view."""
    discounted, undiscounted, costs, weight, clipped = np.zeros(()), np.zeros(()), np.zeros(()), 1.0, 0
    kept = 1 if view.reward.kind == "classic" else len(PAID_BY)
    for block in blocks:
        clipped += block.clipped
        for reward in rewards_of(block.record[:kept], view):
            discounted = discounted + weight * reward
            undiscounted = undiscounted + reward
            weight *= discount
        if view.cost is not None:
            costs = costs + view.cost.of(tuple(block.record[kept:, 1:])).sum(axis=0, dtype=np.float64)
        advance(block.actions.shape[0] * block.actions.shape[1])
    return Returns(discounted, undiscounted, costs, clipped)


def _paired(scenario: Scenario, cell: Cell, number: int, index: Ints) -> Episodes:
    """Episodes of a cell in which the environment's random numbers do not depend on the policy."""
    n, number_in_messages = len(index), number * scenario.episodes + index
    keys, policy_keys = (np.tile(stream_key(scenario.seed, digest), (n, 1)) for digest in _digests(cell))
    return Episodes(
        scenario.world, cell.policy, cell.label, keys, policy_keys, index,
        setpoint=np.full(n, cell.setpoint), number=number_in_messages,
    )  # fmt: skip


def _digests(cell: Cell) -> tuple[bytes, bytes]:
    """The digests in the addresses of the environment's and of the policy's random numbers."""
    form: dict[str, Any] = {**cell.form(), "label": "evaluate"}
    common = {key: value for key, value in form.items() if key != "policy"}
    return form_digest(common), form_digest(form)


def _through(view: ViewOptions, episodes: Episodes, carry: Carry) -> Callable[[Observed], Observed] | None:
    """What a policy made of a user's object sees: the frames of the view. Other policies see no view."""
    history, drifting = episodes.policy.needs.history, episodes.world.drifting
    if view.is_classic or not isinstance(episodes.policy, ObjectPolicy) or history == 0:
        return None
    rows = observed_rows(view, drifting)
    window = Window(view, drifting, len(episodes), history)
    window.begin(episodes.lanes, values_of(carry.state, rows), episodes.index, carry.burn_in)

    def observe(observed: Observed) -> Observed:
        if observed.step.any():
            window.push(episodes.lanes, values_of(carry.state, rows), observed.actions[:, 0])
        return observed._replace(observations=read_only(window.frames))

    return observe


def rewards_of(record: Floats, view: ViewOptions, scale: float = 1.0) -> Floats:
    """The scaled rewards (steps, n), from recorded rewards or costs (1 or 2, steps + 1, n)."""
    if len(record) == 1:
        return scaled(record[0, 1:], scale)
    costs = record.astype(np.float32)
    return view.reward.of(tuple(costs[:, :-1]), tuple(costs[:, 1:]), scale).astype(np.float64)
