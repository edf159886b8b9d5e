"""Episodes for pictures, the same as in a dataset with that seed, in double precision."""

from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata import Experiment
from ibdata.plan.rollout import rollout

Columns = dict[str, npt.NDArray[np.float64]]


def episodes(setpoints: Any, policy: str, steps: int, seed: int, count: int = 1) -> list[Columns]:
    """The first `count` episodes of a cell, each with its variables by name (steps,)."""
    experiment = Experiment(
        name="figure",
        setpoints=setpoints,
        policies=[policy],
        episodes=count,
        steps=steps,
        seed=seed,
        output={"dtype": "float64", "latent": "full"},
    )
    columns = rollout(experiment, 0, count)
    names = [name.removeprefix("obs_").removeprefix("latent_") for name in columns.names]
    table = columns.table.reshape(len(names), count, steps).astype(np.float64)
    return [dict(zip(names, table[:, number], strict=True)) for number in range(count)]
