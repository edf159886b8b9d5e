"""The target policies of docs/policy-selection.md: networks with noise, which gives them densities.

The networks are checkpoints of the training of the baselines.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch.special import ndtr, ndtri

import ibdata
from ibdata.policies import Decision, Distribution
from ibdata.policies.base import Bools, Float32s, Needs, Observed, at_start
from ibdata.policies.network import Network
from training.offline import HISTORY, STEPS, Rows, train
from training.selecting import Checkpoint

SEED = 0  # of the training
SCALE = 0.3  # of the noise
EDGE = 1.0 - 2.0**-24  # the greatest number below 1 of float32
LOG_SQRT_2PI = 0.5 * math.log(2.0 * math.pi)
Floats = npt.NDArray[np.float64]


class TruncatedNormal(Distribution):
    """N(mean, SCALE²) for each number of an action, truncated to (-1, 1). So no action is at ±1.

    Args:
        mean: (n, 3), before the truncation, in [-1, 1], a tensor.
    """

    draws = 3

    def __init__(self, mean: Any) -> None:
        self.mean = mean

    def sample(self, u: Floats) -> Floats:
        actions: Floats = drawn(self.mean, torch.from_numpy(u)).numpy()
        return actions

    def log_density(self, action: Float32s) -> Floats:
        density: Floats = log_density(self.mean, torch.from_numpy(action.astype(np.float64))).numpy()
        return density

    def atoms(self, action: Float32s) -> Bools:
        return np.zeros(action.shape, dtype=np.bool_)


def drawn(mean: Any, u: Any) -> Any:
    """Actions: draws of N(mean, SCALE²), truncated to (-1, 1), by the inverse of the distribution function.

    Args:
        mean: the mean actions (n, 3) before the truncation, in [-1, 1], a tensor.
        u: uniform random numbers (n, 3), a tensor.
    """
    low, high = ndtr((-1.0 - mean) / SCALE), ndtr((1.0 - mean) / SCALE)
    return (mean + SCALE * ndtri(low + (high - low) * u)).clamp(-EDGE, EDGE)


def log_density(mean: Any, action: Any) -> Any:
    """The log density (n,) of `drawn` at actions (n, 3)."""
    z = (action - mean) / SCALE
    inside = ndtr((1.0 - mean) / SCALE) - ndtr((-1.0 - mean) / SCALE)
    return (-0.5 * z**2 - math.log(SCALE) - LOG_SQRT_2PI - inside.log()).sum(1)


class Target:
    """A network with noise, as `ibdata.evaluate` and `ibdata.importance` take it."""

    needs = Needs(history=HISTORY, step_draws=3)

    def __init__(self, file: Path | str) -> None:
        self.network = Network(file=str(file))

    @property
    def sha256(self) -> str:
        """That of the file."""
        return str(self.network.sha256)

    def mean(self, history: Float32s) -> Any:
        """The network's actions (n, 3) for observations (n, HISTORY, 6)."""
        return torch.from_numpy(self.network.decide(at_start(history, self.network.needs)).action)

    def decide(self, observed: Observed) -> Decision:
        """The distribution of the actions."""
        return Decision(TruncatedNormal(self.mean(observed.observations)), observed.memory)


def write_checkpoints(wanted: list[Checkpoint], rows: Rows, folder: Path) -> None:
    """Train an algorithm as `scripts/baselines` does, up to the last of some checkpoints, and write these."""
    by_steps = {each.training_steps: each for each in wanted}

    def keep(step: int, learned: Any) -> None:
        if one := by_steps.get(step):
            path = one.file(folder)
            path.parent.mkdir(parents=True, exist_ok=True)
            said = f"{one.algorithm} on {one.set}, seed {SEED}, {step} of {STEPS} steps"
            ibdata.save_network(path, learned, history=HISTORY, provenance=said)

    train(wanted[0].algorithm, rows, SEED, max(by_steps), keep)
