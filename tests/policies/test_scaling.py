"""Policies that were trained at one setpoint are said to be so, where they are evaluated at another one."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.networks import Environment, Model, weights

import ibdata
from ibdata.policies.libraries import scaling_of
from ibdata.policies.network import Network

MEAN, STD = np.full(6, 50.0), np.array([0.001, 9.0, 9.0, 9.0, 9.0, 9.0])
FAR = "setpoint 75: up to 2.5e+04 standard deviations from 50, the mean in its scaling of observations"
DEAF = "at setpoint 75 its actions depend on hardly anything else that it sees, at others they do: perhaps"


def notes(policy, setpoints=(50.0, 75.0), **options):
    """The notes of an evaluation without their label."""
    found = ibdata.evaluate({"x": policy}, list(setpoints), episodes=2, steps=3, **options)
    return [note.removeprefix("x: ") for note in found.notes if note.startswith("x: ")]


def of_tanh(std, columns=6, at=0, width=30, seed=0):
    """A network of random features whose setpoint, in one column of a frame, is divided by `std`."""
    rng = np.random.default_rng(seed)
    first, second = rng.normal(0.0, 0.1, (columns, width)), rng.normal(0.0, 0.3, (width, 3))
    divisor = np.where(np.arange(columns) == at, std, 30.0)
    return lambda seen: np.tanh((seen.reshape(len(seen), -1) - 50.0) / divisor @ first) @ second


def vec_normalize(var):
    """The model of an environment with a VecNormalize that saw setpoint 50."""
    rms = SimpleNamespace(mean=MEAN, var=var)
    own = type("IndustrialBenchmarkEnv", (Environment,), {"__module__": "ibdata.environment.single"})()
    own.normalize = SimpleNamespace(
        norm_obs=True,
        obs_rms=rms,
        epsilon=0.0,
        clip_obs=10.0,
        normalize_obs=lambda seen: np.clip((seen - MEAN) / np.sqrt(var), -10.0, 10.0).astype(np.float32),
    )
    return Model(own)


class Learned:
    """A model of d3rlpy with a StandardObservationScaler."""

    def __init__(self, std, mean=MEAN):
        self.config = SimpleNamespace(observation_scaler=SimpleNamespace(mean=mean, std=std, eps=1e-9))

    def predict(self, observations):
        return observations[:, :3] / 200.0


@pytest.fixture
def file(tmp_path):
    texts = {"mean": json.dumps(MEAN.tolist()), "std": json.dumps(STD.tolist())}
    (tmp_path / "actor.safetensors").write_bytes(weights(frames=2, **texts))
    return tmp_path / "actor.safetensors"


def test_a_scaling_that_saw_one_setpoint_is_said(file):
    network = Network(file=str(file))
    for policy in (
        network,
        ibdata.policies.POLICIES["gaussian"](base=network, scale=0.1),
        vec_normalize(STD**2),
        vec_normalize(STD**2).predict,
        Learned(STD),
    ):
        [note] = notes(policy)
        assert note.startswith(FAR)
        assert notes(policy, [50.0]) == []


def test_actions_that_depend_on_nothing_else_are_said():
    """Of an object, whose scaling is its own: only if it acts on what it sees at other setpoints."""
    assert notes(of_tanh(1e-6))[-1].startswith(DEAF)
    assert notes(of_tanh(1e-4, width=1000, seed=1))[-1].startswith(DEAF)  # some weights are almost 0
    assert notes(of_tanh(30.0)) == []
    assert notes(lambda seen: np.zeros((len(seen), 3))) == []
    assert notes(lambda seen: seen[:, :3] * [0.01, 0.0, 0.0]) == []  # of the setpoint alone, wherever it is


def test_the_scaling_of_a_library_has_its_epsilon():
    """A column that never varied in training is divided by what the library divides it by."""
    varied = SimpleNamespace(mean=np.zeros(2), var=np.array([4.0, 0.0]))
    env = SimpleNamespace(norm_obs=True, obs_rms=varied, epsilon=0.25, clip_obs=10.0)
    found = scaling_of(SimpleNamespace(get_vec_normalize_env=lambda: env))
    assert found["std"].tolist() == [4.25**0.5, 0.5]
    scaler = SimpleNamespace(mean=np.zeros(2), std=np.array([2.0, 0.0]), eps=0.25)
    found = scaling_of(SimpleNamespace(config=SimpleNamespace(observation_scaler=scaler)))
    assert found["std"].tolist() == [2.25, 0.25]
