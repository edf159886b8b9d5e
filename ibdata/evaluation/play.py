"""The returns of a policy's episodes, on random numbers that it shares with other policies."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.experiment import Experiment
from ibdata.experiment.cells import Cell, form_digest
from ibdata.numerics.random import Purpose
from ibdata.simulation import kernel
from ibdata.simulation.rollout import CHUNK, Block, blocks

Floats = npt.NDArray[np.float64]


class EvaluationBlock(Block):
    """Episodes whose environment draws from the address of the cell without its policy."""

    @staticmethod
    def _digests(cell: Cell) -> tuple[bytes, bytes]:
        form: dict[str, Any] = {**cell.form(), "label": "evaluate"}
        common = {key: value for key, value in form.items() if key != "policy"}
        return form_digest(common), form_digest(form)

    def returns(self, discount: float) -> Iterator[Floats]:
        """Return two sums (n,) over the steps t: of discountᵗ times the reward, and of the reward."""
        discounted, plain, weight = np.zeros(self.n), np.zeros(self.n), 1.0
        action = np.empty((self.n, 3), dtype=np.float32)
        history = np.empty((self.n, self.policy.history_length, 6), dtype=np.float32)
        seen = history.view()
        seen.flags.writeable = False
        kernel.observe(self.state, history, True)
        for t0 in range(0, self.experiment.steps, CHUNK):
            count = min(CHUNK, self.experiment.steps - t0)
            raw, drift = self._dynamics_raw(Purpose.DYNAMICS, Purpose.DRIFT, t0 + 1, count)
            u = self._uniforms(Purpose.POLICY, t0, count, self.policy.uniforms_per_step)
            for t in range(count):
                self.asked.act(seen, u[t], action, t0 + t)
                kernel.step_lanes(self.state, action, raw, drift, t, self.noise, self.parameters)
                kernel.observe(self.state, history, False)
                discounted += weight * self.state.reward
                plain += self.state.reward
                weight *= discount
        yield from (discounted, plain)


def returns(experiment: Experiment, discount: float) -> tuple[Floats, Floats]:
    """Discounted and undiscounted returns (policies, setpoints, episodes) of an experiment's episodes.

    Raises PolicyError where a policy returns something that is no action.
    """
    total = len(experiment.cells) * experiment.episodes
    out = np.empty((2, total))
    for first, stop in blocks(experiment, 0, total):
        out[:, first:stop] = list(EvaluationBlock(experiment, first, stop).returns(discount))
    shape = (len(experiment.policies), -1, experiment.episodes)
    return out[0].reshape(shape), out[1].reshape(shape)
