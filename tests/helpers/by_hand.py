"""Steps whose random numbers are read from their documented addresses."""

from __future__ import annotations

import hashlib

import numpy as np

from ibdata._numerics.exact import exponential, normal
from ibdata._numerics.random import Purpose
from ibdata.dynamics import Noise, State, step
from ibdata.plan.dataset_spec import spec_in


def experiment_of(dataset):
    """The only experiment of a dataset."""
    [experiment] = spec_in(dataset.stored).experiments
    return experiment


def uniforms_at(seed, digest, index, purpose, step, slots):
    """The numbers of one step from U(0, 1), by the words of the documentation."""
    message = b"ibdata noise 1\0" + seed.to_bytes(8, "little") + digest
    key = np.frombuffer(hashlib.sha256(message).digest()[:16], dtype="<u8")
    counter = np.array([step * slots // 4, purpose, index, 0], dtype=np.uint64)
    raw = np.random.Philox(key=key, counter=counter).random_raw(slots)
    return [((int(x) >> 12) + 0.5) * 2.0**-52 for x in raw]


def noise(seed, digest, index, step, drifting=False, purposes=(Purpose.DYNAMICS, Purpose.DRIFT)):
    """The noise of one lane at one step."""
    u = uniforms_at(seed, digest, index, purposes[0], step, 8)
    drift = uniforms_at(seed, digest, index, purposes[1], step, 4) if drifting else [0.0] * 4
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
