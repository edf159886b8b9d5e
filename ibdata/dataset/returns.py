"""How good the behaviour of a dataset was: its returns, on the scale of the reference returns."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pyarrow as pa

from ibdata.dataset import reference_returns
from ibdata.dataset.models import Info
from ibdata.numerics.confidence import estimate


def behaviour_returns(episodes: pa.Table, info: Info) -> dict[str, Any]:
    """The results of `Dataset.returns`, from the table of episodes and info.json.

    Episodes of different lengths, which a merged dataset may have, are different results: each has its own
    mean reward, and a score where there is a scale for its length.
    """
    policies = episodes["policy"].to_pylist()
    setpoints, returns, lengths = (episodes[name].to_numpy() for name in ("setpoint", "return", "length"))
    cells = np.array(episodes["cell"].to_pylist(), dtype=object)
    scales = {steps: _scale(info, steps) for steps in np.unique(lengths).tolist()}
    new = (cells[1:] != cells[:-1]) | (lengths[1:] != lengths[:-1])
    starts = [0, *(np.flatnonzero(new) + 1).tolist(), len(cells)]
    results = []
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
    """The scale for episodes of so many steps."""
    return None if info.drifting else reference_returns.scale(info.dynamics, info.start, steps, 1.0)
