"""Play episodes of policies, with the same random numbers of the environment for all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from numbers import Real
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.errors import UsageError
from ibdata.evaluation.policies import Acting, loaded
from ibdata.experiment import Experiment
from ibdata.experiment.cells import Cell, form_digest
from ibdata.experiment.messages import shown
from ibdata.experiment.plain import plain
from ibdata.experiment.rollout import blocks, cells_of
from ibdata.numerics.random import stream_key
from ibdata.policies import Observed
from ibdata.policies.custom import without_runs
from ibdata.simulation.carry import Carry, begin
from ibdata.simulation.episodes import Episodes, Ints
from ibdata.simulation.unroll import Block, read_only, unroll
from ibdata.simulation.variables import observed_rows, record_rows, values_of
from ibdata.system.progress import Advance, unseen
from ibdata.views.options import PLAIN, ViewOptions
from ibdata.views.rewards import COSTS
from ibdata.views.window import Window

Floats = npt.NDArray[np.float64]


class Played(NamedTuple):
    """What policies got, (policies, setpoints, episodes) unless it says otherwise."""

    discounted: Floats  # returns
    undiscounted: Floats  # returns
    clipped: Floats  # the share of actions that were clipped, (policies, setpoints)

    def first(self, count: int) -> Played:
        """What the first policies got."""
        return Played(*(part[:count] for part in self))


def checked_discount(given: Any) -> float:
    """The discount factor as a float. Raises UsageError if it is not a number in [0, 1]."""
    number = plain(given)
    is_number = isinstance(number, Real) and not isinstance(number, bool)
    if not is_number or not 0 <= number <= 1:
        raise UsageError(f"discount: found {shown(number)}, expected a number in [0, 1]")
    return float(number)


def episodes_of(
    experiment: Experiment, discount: float, advance: Advance = unseen, view: ViewOptions = PLAIN
) -> Played:
    """Play an experiment's episodes, a block never with those of two cells.

    The view says what users' objects see, and what is rewarded. Raises PolicyError if a policy fails.
    """
    cells, episodes, policies = len(experiment.cells), experiment.episodes, len(experiment.policies)
    out, clipped = np.empty((2, cells * episodes)), np.zeros(cells)
    columns = len(view.frame(experiment.drifting))
    for number, policy in enumerate(experiment.policies):
        with loaded([policy], columns):  # one at a time, so that their modules never meet
            for cell in range(number * cells // policies, (number + 1) * cells // policies):
                for first, stop in blocks(experiment, cell * episodes, (cell + 1) * episodes):
                    block_episodes = _paired(experiment, np.arange(first, stop))
                    carry = begin(block_episodes)
                    blocks_played = unroll(
                        block_episodes,
                        carry,
                        record_rows(rewarded(view)),
                        experiment.steps,
                        observe=_through(view, block_episodes, carry),
                    )
                    *both, count = returns_of(blocks_played, discount, advance, view)
                    out[:, first:stop] = both
                    clipped[cell] += count / (episodes * experiment.steps)
    discounted, undiscounted = out.reshape(2, policies, -1, episodes)
    return Played(discounted, undiscounted, clipped.reshape(policies, -1))


def rewarded(view: ViewOptions) -> list[str]:
    """The variables of which rewards are made."""
    return ["reward"] if view.reward.kind == "classic" else list(COSTS)


def returns_of(
    blocks: Iterable[Block], discount: float, advance: Advance = unseen, view: ViewOptions = PLAIN
) -> tuple[Floats, Floats, int]:
    """The discounted and the undiscounted return of each episode (n,); how many actions were clipped.

    The blocks record what is `rewarded` by the view.
    """
    discounted, undiscounted, weight, clipped = np.zeros(()), np.zeros(()), 1.0, 0
    for block in blocks:
        clipped += block.clipped
        for reward in _rewards(block.record, view):
            discounted = discounted + weight * reward
            undiscounted = undiscounted + reward
            weight *= discount
        advance(block.actions.shape[0] * block.actions.shape[1])
    return discounted, undiscounted, clipped


def _paired(experiment: Experiment, numbers: Ints) -> Episodes:
    """Episodes in which the environment's random numbers do not depend on the policy."""
    cells, own, indices = cells_of(experiment, numbers)
    keys, policy_keys = (
        np.array([stream_key(experiment.seed, digest) for digest in digests])[own]
        for digests in zip(*map(_digests, cells), strict=True)
    )
    setpoints = np.array([cell.setpoint for cell in cells])[own]
    policy, label = cells[0].policy, cells[0].label
    return Episodes(experiment.world, policy, label, keys, policy_keys, indices, setpoints, numbers)


def _digests(cell: Cell) -> tuple[bytes, bytes]:
    """The digests in the addresses of the environment's and of the policy's random numbers."""
    form: dict[str, Any] = {**cell.form(), "label": "evaluate"}
    common = {key: value for key, value in form.items() if key != "policy"}
    return form_digest(common), form_digest(without_runs(form))


def _through(view: ViewOptions, episodes: Episodes, carry: Carry) -> Callable[[Observed], Observed] | None:
    """What a policy made of a user's object sees: the frames of the view. Other policies see no view."""
    history, drifting = episodes.policy.needs.history, episodes.world.drifting
    if view.is_classic or not isinstance(episodes.policy, Acting) or history == 0:
        return None
    rows = observed_rows(view, drifting)
    window = Window(view, drifting, len(episodes), history)
    window.begin(episodes.lanes, values_of(carry.state, rows), episodes.index)

    def observe(given: Observed) -> Observed:
        if given.step.any():
            window.push(episodes.lanes, values_of(carry.state, rows), given.actions[:, 0])
        return given._replace(observations=read_only(window.frames))

    return observe


def _rewards(record: Floats, view: ViewOptions) -> Floats:
    """The rewards (steps, n), from recorded rewards or costs (1 or 2, steps + 1, n)."""
    if len(record) == 1:
        rewards: Floats = record[0, 1:]
        return rewards
    costs = record.astype(np.float32)
    return view.reward.of(tuple(costs[:, :-1]), tuple(costs[:, 1:]), 1.0).astype(np.float64)
