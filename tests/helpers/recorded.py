"""An episode of a dataset, and its random integers in the order in which a lane draws them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ibdata.experiment import Experiment
from ibdata.experiment.fields import BurnIn
from ibdata.experiment.rollout import rollout
from ibdata.numerics.random import Purpose, integers, stream_key, uniforms
from ibdata.simulation.carry import burn_in_steps


class Recorded(NamedTuple):
    """The columns (steps,) of an episode by name, and its random integers."""

    columns: dict
    integers: np.ndarray


def recorded_episode(setpoint, dynamics="siemens", start="default", steps=300, seed=3) -> Recorded:
    drifting = isinstance(setpoint, dict)
    experiment = Experiment.model_validate(
        {
            "name": "recorded",
            "setpoints": setpoint,
            "dynamics": dynamics,
            "start": start,
            "policies": [{"kind": "random"}],
            "steps": steps,
            "seed": seed,
        }
    )
    made = rollout(experiment, 0, 1)
    keys = stream_key(seed, experiment.cells[0].digest)[None]

    def raw(purpose, step, count):
        return integers(keys, np.zeros(1, dtype=np.int64), purpose, step, 1, count)[0, :, 0]

    def one_step(dynamics, drift, t):
        return [raw(dynamics, t, 8), *([raw(drift, t, 4)] if drifting else [])]

    drawn = [] if start == "default" else [raw(Purpose.START, 0, 4)]
    drawn += one_step(Purpose.DYNAMICS, Purpose.DRIFT, 0)
    if isinstance(experiment.start, BurnIn):
        u = np.empty((1, 1, 3))
        uniforms(raw(Purpose.START, 0, 4).reshape(1, 4, 1), u)
        for t in range(burn_in_steps(*experiment.start.steps, u[0])[0]):
            drawn += one_step(Purpose.BURN_IN_DYNAMICS, Purpose.BURN_IN_DRIFT, t)
            drawn.append(raw(Purpose.BURN_IN_POLICY, t, 4))
    for t in range(steps):
        drawn += one_step(Purpose.DYNAMICS, Purpose.DRIFT, t + 1)
    return Recorded(dict(zip(made.names, made.table, strict=True)), np.concatenate(drawn))
