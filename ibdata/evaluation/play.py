"""Play episodes of policies, with the same random numbers of the environment for all of them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.experiment import Experiment
from ibdata.experiment.cells import Cell, form_digest
from ibdata.simulation.rollout import CHUNK, Block, blocks
from ibdata.simulation.variables import record_rows
from ibdata.system.progress import Advance, unseen

Floats = npt.NDArray[np.float64]


class EvaluationBlock(Block):
    """Episodes in which the environment's random numbers do not depend on the policy."""

    @staticmethod
    def _digests(cell: Cell) -> tuple[bytes, bytes]:
        form: dict[str, Any] = {**cell.form(), "label": "evaluate"}
        common = {key: value for key, value in form.items() if key != "policy"}
        return form_digest(common), form_digest(form)

    def returns(self, discount: float, advance: Advance = unseen) -> tuple[Floats, Floats, int]:
        """The discounted and the undiscounted return of each episode (n,); how many actions were clipped."""
        chunk = min(CHUNK, self.experiment.steps)
        rewards = np.empty((1, chunk + 1, self.n))
        actions = np.empty((chunk, self.n, 3), dtype=np.float32)
        discounted, plain, weight, total = np.zeros(self.n), np.zeros(self.n), 1.0, 0
        for _, count, clipped in self.play(rewards, record_rows(["reward"]), actions):
            total += clipped
            for reward in rewards[0, 1 : count + 1]:
                discounted += weight * reward
                plain += reward
                weight *= discount
            advance(count * self.n)
        return discounted, plain, total


class Played(NamedTuple):
    """What policies got, (policies, setpoints, episodes) unless it says otherwise."""

    discounted: Floats  # returns
    undiscounted: Floats  # returns
    clipped: Floats  # the share of actions that were clipped, (policies, setpoints)


def episodes_of(experiment: Experiment, discount: float, advance: Advance = unseen) -> Played:
    """Play an experiment's episodes, a block never with those of two cells.

    `advance` is called with the number of steps of each part.

    Raises PolicyError if a policy fails or returns no valid action.
    """
    cells, episodes = len(experiment.cells), experiment.episodes
    out, clipped = np.empty((2, cells * episodes)), np.zeros(cells)
    for cell in range(cells):
        for first, stop in blocks(experiment, cell * episodes, (cell + 1) * episodes):
            *both, count = EvaluationBlock(experiment, first, stop).returns(discount, advance)
            out[:, first:stop] = both
            clipped[cell] += count / (episodes * experiment.steps)
    policies = len(experiment.policies)
    discounted, undiscounted = out.reshape(2, policies, -1, episodes)
    return Played(discounted, undiscounted, clipped.reshape(policies, -1))
