"""The recorded episodes of a dataset, part by part."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ibdata.evaluation.states import Source
from ibdata.experiment import Experiment
from ibdata.experiment.rollout import PART_ROWS
from ibdata.policies import Policy
from ibdata.simulation.episodes import Float32s, Floats, Ints


class Recorded(NamedTuple):
    """Recorded episodes."""

    observations: Float32s  # (n, steps, 6)
    actions: Float32s  # (n, steps, 3)


class Part(NamedTuple):
    """Episodes of an experiment with the same policy."""

    experiment: Experiment
    numbers: Ints  # of the episodes in the experiment
    own: Ints  # their places among all

    @property
    def behaviour(self) -> Policy:
        """The policy."""
        policy: Policy = self.experiment.cells[self.numbers[0] // self.experiment.episodes].policy
        return policy


def parts_of(source: Source, episodes: Ints, steps: int) -> Iterator[Part]:
    """Divide episodes (n,) into parts of bounded memory, those of a policy alike in size."""
    most = max(1, PART_ROWS // steps)
    for experiment, own, numbers in source.by_experiment(episodes):
        per_policy = experiment.episodes * (len(experiment.cells) // len(experiment.policies))
        for policy in np.unique(numbers // per_policy):
            same = np.flatnonzero(numbers // per_policy == policy)
            for some in np.array_split(same, -(-len(same) // most)):
                yield Part(experiment, numbers[some], own[some])


def recorded_in(source: Source, episodes: Ints, steps: int) -> tuple[Recorded, Floats, Floats]:
    """What was seen and done in the first steps of episodes, and the rewards and log densities (n, steps)."""
    info = source.ds.info_model
    observed, acted = info.names("observation"), info.names("action")
    names, counts = [*observed, *acted, "reward", "action_log_prob"], np.full(len(episodes), steps)
    *values, reward, log_prob = source.stored(names, episodes, counts, np.dtype(np.float64))
    rows = np.stack(values, axis=2).astype(np.float32)
    return Recorded(rows[..., : len(observed)], rows[..., len(observed) :]), reward, log_prob
