"""What lies between a model of Stable-Baselines3 and ibdata's environment is applied, refused or said."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from helpers.networks import Model, layers
from helpers.refusals import refused

import ibdata
from ibdata.policies import checked
from ibdata.policies.libraries import environment_note
from ibdata.testing import check_policy
from ibdata.views.options import OBSERVED, view_of

OWN = "ibdata.environment.single.IndustrialBenchmarkEnv"
VECTORS = "stable_baselines3.common.vec_env"
DUMMY, SUBPROCESSES = f"{VECTORS}.dummy_vec_env.DummyVecEnv", f"{VECTORS}.subproc_vec_env.SubprocVecEnv"
MONITOR = "stable_baselines3.common.monitor.Monitor"
LIMIT = "gymnasium.wrappers.common.TimeLimit"
NORMALIZE = "gymnasium.wrappers.stateful_observation.NormalizeObservation"


def vectors(*lanes, over=(), kind=DUMMY):
    """A vector environment over lanes, each a list of layers."""
    return layers(*over, kind, envs=[layers(*lane) for lane in lanes])


def elsewhere(*texts):
    """A vector environment whose lanes are in other processes and describe themselves."""
    return layers(SUBPROCESSES, remotes=[], env_method=lambda name: list(texts))


def ended(name):
    raise EOFError


REFUSED = {
    "of gymnasium": (vectors([MONITOR, NORMALIZE, LIMIT, OWN]), "NormalizeObservation"),
    "of another lane": (vectors([OWN], [NORMALIZE, OWN]), "NormalizeObservation"),
    "of a user, with a known name": (vectors(["mine.TimeLimit", OWN]), "TimeLimit"),
    "an environment that holds another": (vectors(["mine.Holder", LIMIT, OWN]), "Holder"),
    "around all lanes": (vectors([OWN], over=["mine.VecHalved"]), "VecHalved"),
    "a user's loop over lanes": (vectors([OWN], kind="mine.DummyVecEnv"), "DummyVecEnv"),
    "in a process": (elsewhere("<TimeLimit<Halved<IndustrialBenchmarkEnv<ibdata/X-v1>>>>"), "Halved"),
    "around ended ones": (layers("mine.VecHalved", SUBPROCESSES, remotes=[], env_method=ended), "VecHalved"),
    "a stack": (vectors([OWN], over=[f"{VECTORS}.VecFrameStack"]), "VecFrameStack, whi"),
}


@pytest.mark.parametrize(("env", "name"), REFUSED.values(), ids=REFUSED)
def test_a_wrapper_that_is_not_known_is_refused(env, name):
    refused(f"model: found (the wrapper )?{name}.*; train", environment_note, Model(env))


STATEMENTS = {
    "none": (None, "the model has no environment, so it is given"),
    "foreign": (vectors([LIMIT, "mine.Plant"]), "the model's environment is Plant, not ibdata's; wh"),
    "foreign lanes": (layers("mine.Plants"), "the model's environment is Plants, not ibdata's; w"),
    "foreign processes": (elsewhere("<Monitor<Plant instance>>"), "the model's environment is Plant, not"),
    "ended": (layers(SUBPROCESSES, remotes=[], env_method=ended), "the processes of the model's environment"),
    "one lane": (vectors([MONITOR, LIMIT, OWN]), None),
    "known": (vectors([OWN], over=["stable_baselines3.VecNormalize", "stable_baselines3.VecMonitor"]), None),
    "vectors of ibdata": (layers("ibdata.environment.sb3.IndustrialBenchmarkVecEnv"), None),
    "processes": (elsewhere("<TimeLimit<IndustrialBenchmarkEnv<ibdata/IndustrialBenchmark-v0>>>"), None),
}  # fmt: skip


@pytest.mark.parametrize(("env", "line"), STATEMENTS.values(), ids=STATEMENTS)
def test_an_environment_that_is_not_known_is_said(env, line):
    note = environment_note(Model(env))
    assert note is None if line is None else note.startswith(line)


DELAY = {"imperfections": {"delay": {"obs_fatigue": 3}}}


def test_another_view_is_said():
    model = Model(vectors([OWN]))
    for trained, given, is_said in (
        (DELAY, DELAY, False),
        (DELAY, None, True),
        (None, DELAY, True),
        ({"reward": "delta", "reward_scale": 0.5}, None, False),
        ({"observe": [*reversed(OBSERVED)]}, None, True),
        ({"observe": list(OBSERVED)}, None, False),
    ):
        model.env.view = view_of(trained)
        notes = ibdata.evaluate(model, **FEW, view=given).notes
        assert any("trained with another view than it is given here" in note for note in notes) == is_said


FEW = {"episodes": 2, "steps": 2}
RUN = {"name": "x", "setpoints": 70, "steps": 2}
DOORS = {
    "evaluate": lambda model: ibdata.evaluate(model, **FEW),
    "a partial of predict": lambda model: ibdata.evaluate(partial(model.predict), **FEW),
    "a base": lambda model: ibdata.evaluate({"kind": "sticky", "base": model, "kappa": 0.1}, **FEW),
    "generate": lambda model: ibdata.generate({**RUN, "policies": [model]}, overwrite=True),
    "check_policy": lambda model: check_policy(model, checked.histories(2, 1)),
}


@pytest.mark.parametrize("door", DOORS.values(), ids=DOORS)
def test_every_use_of_a_model_refuses_and_says_the_same(tmp_path, monkeypatch, capsys, door):
    monkeypatch.chdir(tmp_path)
    refused("found the wrapper NormalizeObservation", door, Model(vectors([NORMALIZE, OWN])))
    assert list(tmp_path.iterdir()) == []
    for model, count in ((Model(), 1), (Model(vectors([OWN])), 0)):
        said = [*getattr(door(model), "notes", []), *capsys.readouterr().err.splitlines()]
        assert len([line for line in said if "the model has no environment, so it is given" in line]) == count


def test_a_network_without_its_environment_is_saved_with_a_given_scaling_only(tmp_path, capsys):
    """Else nobody knows whether observations went through a VecNormalize."""
    file = tmp_path / "actor.safetensors"
    for env, said in (
        (None, "^model: found no environment, which keeps VecN"),
        (vectors([NORMALIZE, OWN]), "NormalizeO"),
    ):
        refused(said, ibdata.save_network, file, Model(env))
        assert list(tmp_path.iterdir()) == []
    ibdata.save_network(file, Model(), mean=np.zeros(6), std=np.ones(6))
    ibdata.save_network(file, Model(vectors([OWN])))
    assert capsys.readouterr().err == ""
