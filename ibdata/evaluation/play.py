"""Play episodes of policies, with the same random numbers of the environment for all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.errors import UsageError
from ibdata.evaluation.policies import Acting, loaded, notes_on
from ibdata.experiment import Experiment
from ibdata.experiment.cells import Cell, form_digest
from ibdata.experiment.rollout import blocks, cells_of
from ibdata.numerics.random import stream_key
from ibdata.policies import POLICIES, Observed, Policy
from ibdata.policies.custom import without_runs
from ibdata.policies.user_object import UserObject, clipping_notes
from ibdata.simulation.driver import CHUNK, Lanes, Run, read_only
from ibdata.simulation.variables import observed_rows, record_rows, values_of
from ibdata.simulation.world import Float32s, Ints
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
    notes: list[list[str]]  # on each policy

    def first(self, count: int) -> Played:
        """What the first policies got."""
        return Played._make(part[:count] for part in self)


def checked_discount(discount: float) -> float:
    """The discount factor as a float. Raises UsageError if it is not in [0, 1]."""
    if not 0 <= discount <= 1:
        raise UsageError(f"discount: found {discount}, expected a number in [0, 1]")
    return float(discount)


def episodes_of(
    experiment: Experiment, discount: float, advance: Advance = unseen, view: ViewOptions = PLAIN
) -> Played:
    """Play an experiment's episodes, a block never with those of two cells.

    The view says what users' objects see, and what is rewarded. Raises PolicyError if a policy fails.
    """
    cells, episodes, policies = len(experiment.cells), experiment.episodes, len(experiment.policies)
    out, clipped = np.empty((2, cells * episodes)), np.zeros(cells)
    columns, notes = len(view.frame(experiment.drifting)), []
    for number, policy in enumerate(experiment.policies):
        with loaded([policy], columns, says=False):  # one at a time, so that their modules never meet
            for cell in range(number * cells // policies, (number + 1) * cells // policies):
                for first, stop in blocks(experiment, cell * episodes, (cell + 1) * episodes):
                    run = Run(experiment.world, _lanes(experiment, np.arange(first, stop)))
                    seen = _through(view, run)
                    *both, count = returns_of(run, discount, advance, view, seen)
                    out[:, first:stop] = both
                    clipped[cell] += count / (episodes * experiment.steps)
            notes.append(list(_notes(policy, view, clipped.reshape(policies, -1)[number].mean())))
    discounted, undiscounted = out.reshape(2, policies, -1, episodes)
    return Played(discounted, undiscounted, clipped.reshape(policies, -1), notes)


def _notes(policy: Policy, view: ViewOptions, clipped: float) -> Iterator[str]:
    """What is to be said of a user's code that has played; a share of its actions was clipped."""
    yield from notes_on(policy, view)
    if not isinstance(policy, UserObject) and type(policy) not in POLICIES.values():
        yield from clipping_notes(clipped, 1.0, "actions")


def returns_of(
    run: Run,
    discount: float,
    advance: Advance = unseen,
    view: ViewOptions = PLAIN,
    observe: Callable[[Observed], Observed] | None = None,
    first_actions: Float32s | None = None,
) -> tuple[Floats, Floats, int]:
    """The discounted and the undiscounted return of each episode (n,); how many actions were clipped.

    The view says what is rewarded; see `Run.play` for the last two arguments.
    """
    chunk = min(CHUNK, run.world.steps)
    wanted = ["reward"] if view.reward.kind == "classic" else list(COSTS)
    record = np.empty((len(wanted), chunk + 1, run.n))
    actions = np.empty((chunk, run.n, 3), dtype=np.float32)
    discounted, undiscounted, weight, total = np.zeros(run.n), np.zeros(run.n), 1.0, 0
    played = run.play(record, record_rows(wanted), actions, None, observe, first_actions)
    for _, count, clipped in played:
        total += clipped
        for reward in _rewards(record[:, : count + 1], view):
            discounted += weight * reward
            undiscounted += reward
            weight *= discount
        advance(count * run.n)
    return discounted, undiscounted, total


def _lanes(experiment: Experiment, numbers: Ints) -> Lanes:
    """Episodes in which the environment's random numbers do not depend on the policy."""
    cells, own, indices = cells_of(experiment, numbers)
    keys, policy_keys = (
        np.array([stream_key(experiment.seed, digest) for digest in digests])[own]
        for digests in zip(*map(_digests, cells), strict=True)
    )
    setpoints = np.array([cell.setpoint for cell in cells])[own]
    return Lanes(cells[0].policy, keys, policy_keys, indices, setpoints, cells[0].label, numbers)


def _digests(cell: Cell) -> tuple[bytes, bytes]:
    """The digests in the addresses of the environment's and of the policy's random numbers."""
    form: dict[str, Any] = {**cell.form(), "label": "evaluate"}
    common = {key: value for key, value in form.items() if key != "policy"}
    return form_digest(common), form_digest(without_runs(form))


def _through(view: ViewOptions, run: Run) -> Callable[[Observed], Observed] | None:
    """What a policy made of a user's object sees: the frames of the view. Other policies see no view."""
    if view.is_classic or not isinstance(run.lanes.policy, Acting) or run.needs.history == 0:
        return None
    drifting = run.world.drifting
    rows = observed_rows(view, drifting)
    window = Window(view, drifting, run.n, run.needs.history)
    window.begin(run.everyone, values_of(run.state, rows), run.lanes.indices)

    def observe(given: Observed) -> Observed:
        if given.step.any():
            window.push(run.everyone, values_of(run.state, rows), given.actions[:, 0])
        return given._replace(observations=read_only(window.frames))

    return observe


def _rewards(record: Floats, view: ViewOptions) -> Floats:
    """The rewards (steps, n), from recorded rewards or costs (1 or 2, steps + 1, n)."""
    if len(record) == 1:
        rewards: Floats = record[0, 1:]
        return rewards
    costs = record.astype(np.float32)
    return view.reward.of(tuple(costs[:, :-1]), tuple(costs[:, 1:]), 1.0).astype(np.float64)
