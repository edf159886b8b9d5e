"""Episodes for figures, the same as in a dataset with that seed, in double precision."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.experiment import Experiment
from ibdata.experiment.rollout import rollout

Columns = dict[str, npt.NDArray[np.float64]]


def episodes(
    dynamics: str, setpoints: Any, policy: str, steps: int, seed: int, count: int = 1
) -> list[Columns]:
    """The first `count` episodes of a cell, each with its columns (steps,) and the derived values."""
    experiment = Experiment.model_validate(
        {
            "name": "figure",
            "dynamics": dynamics,
            "setpoints": setpoints,
            "policies": [{"kind": policy}],
            "episodes": count,
            "steps": steps,
            "seed": seed,
            "output": {"dtype": "float64", "latent": "full"},
        }
    )
    made = rollout(experiment, 0, count)
    table = made.table.reshape(len(made.names), count, steps)
    return [{name: table[i, j].astype(np.float64) for i, name in enumerate(made.names)} for j in range(count)]
