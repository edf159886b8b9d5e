"""Play episodes of policies, with the same random numbers of the environment for all of them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.evaluation.policies import Acting, loaded
from ibdata.experiment import Experiment
from ibdata.experiment.cells import Cell, form_digest
from ibdata.policies.code_places import looking_here
from ibdata.policies.given import Given
from ibdata.simulation.rollout import CHUNK, Block, blocks, read_only
from ibdata.simulation.variables import observed_rows, record_rows, values_of
from ibdata.system.progress import Advance, unseen
from ibdata.views.options import PLAIN, ViewOptions
from ibdata.views.rewards import COSTS
from ibdata.views.window import Window

Floats = npt.NDArray[np.float64]


class EvaluationBlock(Block):
    """Episodes in which the environment's random numbers do not depend on the policy.

    A policy made of a user's object sees them through a view; other policies see the observed variables.
    """

    view: ViewOptions = PLAIN
    window: Window | None = None  # of a policy that sees a view

    def __init__(self, experiment: Experiment, first: int, stop: int, view: ViewOptions) -> None:
        self.view = view
        super().__init__(experiment, first, stop)

    def _begin(self, setpoints: Floats) -> None:
        super()._begin(setpoints)
        length = self.policy.history_length
        if self.view.is_classic or not isinstance(self.policy, Acting) or length == 0:
            return
        drifting = self.experiment.drifting
        self.observed = observed_rows(self.view, drifting)
        self.window = Window(self.view, drifting, self.n, length)
        self.window.begin(self.lanes, values_of(self.state, self.observed), self.indices)

    def questions(self, t: int, count: int, span: int) -> Iterator[Given]:
        """As in `Block`, with the frames of the view in place of the observations."""
        for i, given in enumerate(super().questions(t, count, span)):
            if self.window is None:
                yield given
                continue
            if t + i:
                self.window.push(self.lanes, values_of(self.state, self.observed), given.actions[:, 0])
            yield given._replace(observations=read_only(self.window.frames))

    @staticmethod
    def _digests(cell: Cell) -> tuple[bytes, bytes]:
        form: dict[str, Any] = {**cell.form(), "label": "evaluate"}
        common = {key: value for key, value in form.items() if key != "policy"}
        return form_digest(common), form_digest(form)

    def returns(self, discount: float, advance: Advance = unseen) -> tuple[Floats, Floats, int]:
        """The discounted and the undiscounted return of each episode (n,); how many actions were clipped."""
        chunk = min(CHUNK, self.experiment.steps)
        wanted = ["reward"] if self.view.reward.kind == "classic" else list(COSTS)
        record = np.empty((len(wanted), chunk + 1, self.n))
        actions = np.empty((chunk, self.n, 3), dtype=np.float32)
        discounted, plain, weight, total = np.zeros(self.n), np.zeros(self.n), 1.0, 0
        for _, count, clipped in self.play(record, record_rows(wanted), actions):
            total += clipped
            for reward in self._rewards(record[:, : count + 1]):
                discounted += weight * reward
                plain += reward
                weight *= discount
            advance(count * self.n)
        return discounted, plain, total

    def _rewards(self, record: Floats) -> Floats:
        """The rewards (steps, n), from recorded rewards or costs (1 or 2, steps + 1, n)."""
        if len(record) == 1:
            rewards: Floats = record[0, 1:]
            return rewards
        costs = record.astype(np.float32)
        return self.view.reward.of(tuple(costs[:, :-1]), tuple(costs[:, 1:]), 1.0).astype(np.float64)


class Played(NamedTuple):
    """What policies got, (policies, setpoints, episodes) unless it says otherwise."""

    discounted: Floats  # returns
    undiscounted: Floats  # returns
    clipped: Floats  # the share of actions that were clipped, (policies, setpoints)


@looking_here()
def episodes_of(
    experiment: Experiment, discount: float, advance: Advance = unseen, view: ViewOptions = PLAIN
) -> Played:
    """Play an experiment's episodes, a block never with those of two cells.

    The view says what users' objects see, and what is rewarded. `advance` is called with the number of steps
    of each part.

    Raises PolicyError if a policy fails or returns no valid action.
    """
    cells, episodes, policies = len(experiment.cells), experiment.episodes, len(experiment.policies)
    out, clipped = np.empty((2, cells * episodes)), np.zeros(cells)
    for number, policy in enumerate(experiment.policies):
        with loaded([policy]):  # one at a time, so that their modules never meet
            for cell in range(number * cells // policies, (number + 1) * cells // policies):
                for first, stop in blocks(experiment, cell * episodes, (cell + 1) * episodes):
                    *both, count = EvaluationBlock(experiment, first, stop, view).returns(discount, advance)
                    out[:, first:stop] = both
                    clipped[cell] += count / (episodes * experiment.steps)
    discounted, undiscounted = out.reshape(2, policies, -1, episodes)
    return Played(discounted, undiscounted, clipped.reshape(policies, -1))
