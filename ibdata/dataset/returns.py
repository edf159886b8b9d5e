"""How good the behaviour of a dataset was: its returns, on the scale of the reference returns."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pyarrow as pa

from ibdata import reference
from ibdata.estimates import estimate


def behaviour_returns(episodes: pa.Table, info: dict[str, Any]) -> dict[str, Any]:
    """The results of `Dataset.returns`, from the table of episodes and info.json."""
    steps = info["counts"]["steps"]
    scale = None if info["drifting"] else reference.scale(info["dynamics"], info.get("start"), steps, 1.0)
    policies = episodes["policy"].to_pylist()
    setpoints, returns = (episodes[name].to_numpy() for name in ("setpoint", "return"))
    cells = np.array(episodes["cell"].to_pylist(), dtype=object)
    starts = [0, *(np.flatnonzero(cells[1:] != cells[:-1]) + 1).tolist(), len(cells)]
    results = []
    for start, stop in pairwise(starts):  # episodes are in the order of their cells
        found = estimate([returns[start:stop]])
        setpoint = float(setpoints[start])
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
    return {"results": results, "scale": scale.text if scale else None}
