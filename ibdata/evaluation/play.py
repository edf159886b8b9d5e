"""The returns of policies, with the same random numbers of the environment for all of them."""

from __future__ import annotations

from typing import Any

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

    def returns(self, discount: float, advance: Advance = unseen) -> tuple[Floats, Floats]:
        """The discounted and the undiscounted return of each episode, (n,)."""
        chunk = min(CHUNK, self.experiment.steps)
        rewards = np.empty((1, chunk + 1, self.n))
        actions = np.empty((chunk, self.n, 3), dtype=np.float32)
        discounted, plain, weight = np.zeros(self.n), np.zeros(self.n), 1.0
        for _, count, _ in self.play(rewards, record_rows(["reward"]), actions):
            for reward in rewards[0, 1 : count + 1]:
                discounted += weight * reward
                plain += reward
                weight *= discount
            advance(count * self.n)
        return discounted, plain


def returns(experiment: Experiment, discount: float, advance: Advance = unseen) -> tuple[Floats, Floats]:
    """Discounted and undiscounted returns (policies, setpoints, episodes) of an experiment's episodes.

    `advance` is called with the number of steps of each part.

    Raises PolicyError if a policy fails or returns no valid action.
    """
    total = len(experiment.cells) * experiment.episodes
    out = np.empty((2, total))
    for first, stop in blocks(experiment, 0, total):
        out[:, first:stop] = EvaluationBlock(experiment, first, stop).returns(discount, advance)
    shape = (len(experiment.policies), -1, experiment.episodes)
    return out[0].reshape(shape), out[1].reshape(shape)
