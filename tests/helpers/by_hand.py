"""Steps and episodes whose random numbers are read from their documented addresses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ibdata._numerics.exact import exponential, normal
from ibdata._numerics.random import Purpose, integers, stream_key, uniform, uniforms
from ibdata._simulation.carry import burn_in_steps
from ibdata.dynamics import Noise, State, step
from ibdata.experiment import Experiment
from ibdata.experiment.dataset_spec import spec_in
from ibdata.experiment.fields import BurnIn
from ibdata.experiment.rollout import rollout


def experiment_of(dataset):
    """The only experiment of a dataset."""
    [experiment] = spec_in(dataset.stored).experiments
    return experiment


def uniforms_at(seed, digest, index, purpose, step, slots):
    """The numbers of one step from U(0, 1)."""
    key = stream_key(seed, digest)
    raw = integers(key[None], np.array([index]), purpose, step, 1, slots)[0, :, 0]
    return [uniform(x) for x in raw]


def noise(seed, digest, index, step, drifting=False):
    """The noise of one lane at one step."""
    u = uniforms_at(seed, digest, index, Purpose.DYNAMICS, step, 8)
    drift = uniforms_at(seed, digest, index, Purpose.DRIFT, step, 4) if drifting else [0.0] * 4
    values = [exponential(u[0]), exponential(u[1]), *u[2:6], normal(u[6]), normal(u[7]), *drift]
    return Noise(*(np.array([x]) for x in values))


def moved(state, action, noise, variant):
    """The state of one lane after an action (3,)."""
    return step(state, np.asarray(action, dtype=np.float32)[None], noise, variant)


def lane(state, i):
    """One lane of a state."""
    return state.take(np.array([i]))


def side_by_side(*states):
    """One state of all lanes of several."""
    return State(np.concatenate([state.values for state in states], axis=1))


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
