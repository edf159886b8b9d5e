"""The target policies of docs/policy-selection.md: networks with noise, which gives them densities."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
import torch
from torch.special import ndtr, ndtri

from ibdata.policies.base import History
from ibdata.policies.network import Network
from ibdata.policies.support import INSIDE, Support, each
from training.offline import HISTORY

SCALE = 0.3  # of the noise
EDGE = 1.0 - 2.0**-24  # the greatest number below 1 of float32
LOG_SQRT_2PI = 0.5 * math.log(2.0 * math.pi)
Floats = npt.NDArray[np.float64]


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

    history_length = HISTORY
    uniforms_per_step = 3
    support: ClassVar[Support] = each(INSIDE)

    def __init__(self, file: Path | str) -> None:
        self.network = Network(file=str(file))

    @property
    def sha256(self) -> str:
        """That of the file."""
        return str(self.network.sha256)

    def mean(self, history: History) -> Any:
        """The network's actions (n, 3) for observations (n, HISTORY, 6)."""
        return torch.from_numpy(self.network.act(history, np.empty((len(history), 0))))

    def act(self, history: History, u: Floats) -> Floats:
        """Actions (n, 3) from uniform random numbers (n, 3)."""
        actions: Floats = drawn(self.mean(history), torch.from_numpy(u)).numpy()
        return actions

    def log_prob(self, history: History, action: npt.NDArray[np.float32]) -> Floats:
        """The log densities (n,) of actions (n, 3)."""
        density: Floats = log_density(self.mean(history), torch.from_numpy(action.astype(np.float64))).numpy()
        return density
