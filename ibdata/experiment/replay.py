"""The log densities of recorded actions."""

from __future__ import annotations

import numpy as np

from ibdata.experiment.models import Experiment
from ibdata.experiment.rollout import blocks, episodes_of
from ibdata.policies.distributions import Distribution
from ibdata.simulation.episodes import Float32s, Floats, Ints
from ibdata.simulation.replay import replay


def log_densities(
    experiment: Experiment,
    first: int,
    stop: int,
    observations: Float32s,
    actions: Float32s,
) -> Floats:
    """The log densities (n, steps) of the actions of episodes first … stop - 1, all of one policy.

    The recorded observations are (n, steps, 6), and the actions (n, steps, 3).
    """
    densities = np.empty(actions.shape[:2])
    for start, end in blocks(experiment, first, stop):  # blocks limit the memory
        rows = slice(start - first, end - first)
        densities[rows] = _block_densities(
            experiment, np.arange(start, end), observations[rows], actions[rows]
        )
    return densities


def _block_densities(
    experiment: Experiment, numbers: Ints, observations: Float32s, actions: Float32s
) -> Floats:
    """The log densities (n, steps) of the actions of the episodes of a block."""
    episodes = episodes_of(experiment, numbers)

    def log_density(distribution: Distribution, actions: Float32s) -> tuple[Floats]:
        return (distribution.log_density(actions),)

    [densities] = replay(episodes, observations, actions, log_density, actions)
    return densities
