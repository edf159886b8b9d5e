"""The returns of a dataset's behaviour, scored on the scale of the reference returns."""

from __future__ import annotations

from itertools import pairwise
from typing import TypedDict

import numpy as np
import pyarrow as pa

from ibdata.dataset import reference_returns
from ibdata.dataset.models import Info
from ibdata.numerics.confidence import estimate


class Result(TypedDict):
    """The returns of a policy at a setpoint."""

    policy: str
    setpoint: float
    episodes: int
    mean_return: float
    standard_error: float | None  # of the mean; None for one episode
    interval: tuple[float, float] | None  # of 95 % confidence
    mean_reward: float  # per step
    score: float | None


class Returns(TypedDict):
    """The results, and the meaning of their scores; None if there are no scores."""

    results: list[Result]
    scale: str | None


def behaviour_returns(episodes: pa.Table, info: Info) -> Returns:
    """The undiscounted returns of a dataset's behaviour.

    Episodes of different lengths, which a merged dataset may have, give separate results.

    Args:
        episodes: The table of episodes.
        info: The dataset's info.json.

    Returns:
        A result for each cell and length, in the order of the episodes.
    """
    policies = episodes["policy"].to_pylist()
    setpoints, returns, lengths = (episodes[name].to_numpy() for name in ("setpoint", "return", "length"))
    cells = np.array(episodes["cell"].to_pylist(), dtype=object)
    scales = {steps: _scale(info, steps) for steps in np.unique(lengths).tolist()}
    new = (cells[1:] != cells[:-1]) | (lengths[1:] != lengths[:-1])
    starts = [0, *(np.flatnonzero(new) + 1).tolist(), len(cells)]
    results: list[Result] = []
    for start, stop in pairwise(starts):  # episodes are in the order of their cells
        found = estimate([returns[start:stop]])
        setpoint, steps = float(setpoints[start]), int(lengths[start])
        scale = scales[steps]
        results.append(
            {
                "policy": policies[start],
                "setpoint": setpoint,
                "episodes": stop - start,
                "mean_return": found.mean,
                "standard_error": found.standard_error,
                "interval": found.interval,
                "mean_reward": found.mean / steps,
                "score": scale.score(setpoint, found.mean) if scale else None,
            }
        )
    return {"results": results, "scale": "; ".join(s.text for s in scales.values() if s) or None}


def _scale(info: Info, steps: int) -> reference_returns.Scale | None:
    """The scale for episodes with this number of steps."""
    return None if info.drifting else reference_returns.scale(info.dynamics, info.start, steps, 1.0)
