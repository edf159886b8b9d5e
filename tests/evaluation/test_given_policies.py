"""Policies as users give them to an evaluation, and arguments that are refused."""

from __future__ import annotations

import re

import numpy as np
import pytest
from helpers.evaluating import NUDGE, returns
from helpers.refusals import refused

import ibdata
from ibdata import evaluate
from ibdata.errors import ConfigError, PolicyError, UsageError
from ibdata.policies import Certain, Decision, Needs, Uniform
from ibdata.views.imperfections import Measurement, imperfections_of
from ibdata.views.options import OBSERVED


class SeesThree:
    """An object that says itself how many observations it sees."""

    needs = Needs(history=3)

    def decide(self, observed):
        return Decision(Certain(np.zeros((len(observed.observations), 3))), observed.memory)


REFUSED = [
    ({"setpoint": 101}, "setpoint: found 101, expected a number of at most 100"),
    ({"dynamics": {"base": "paper", "eta_men": 1}}, "dynamics.eta_men: no such option; did you mean"),
    ({"discount": 1.5}, "discount: found 1.5, expected a number in [0, 1]"),
    ({"history": 0, "policy": len}, "history: found 0, expected a whole number of at least 1"),
    ({"history": 2, "policy": ["optimized"]}, "history: found 2, but no object that could see so many"),
    ({"history": 2, "policy": SeesThree()}, "history: found 2, but no object that could see so many"),
    ({"history": {"a": 2}, "policy": {"a": {"kind": "custom", "target": len}}}, "found 'a'"),
    ({"history": {"x": 2}, "policy": {"y": len}}, "history: found 'x', expected one of y: others set"),
    ({"policy": SeesThree}, "policy: found the class SeesThree, expected an object: SeesThree(…)"),
    ({"policy": {"mine": 3}}, "policy: found 3, expected one policy: a kind, a block, an object with decide"),
    ({"policy": "optimised"}, "did you mean 'optimized'?"),
    ({"policy": "kind: rndom"}, "policy: kind: found 'rndom'; did you mean 'random'?"),
    ({"policy": {"kind": "gaussian", "scale": 1}}, "policy: base: missing, expected a value"),
]  # fmt: skip


@pytest.mark.parametrize(("arguments", "message"), REFUSED)
def test_what_cannot_be_meant_is_one_line(arguments, message):
    refused(re.escape(message), evaluate, **{"policy": "random", "episodes": 2, **arguments})


def test_a_policy_may_stand_in_a_file(tmp_path):
    file = tmp_path / "policy.yaml"
    file.write_text("kind: constant\naction: [0.5, -1, 0.25]\n")
    np.testing.assert_array_equal(returns(file), returns(NUDGE))
    file.write_text("kind: constant\nactoin: 1\n")
    refused(r"policy.yaml: actoin: no such option; did you mean 'action'\?", returns, file, error=ConfigError)


def test_a_file_of_a_model_says_what_to_do(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, message in (
        (
            "ppo.zip",
            "ppo.zip: found a file .*; if it holds a model, load that in Python and call",
        ),
        ("actor.safetensors", "policy actor.safetensors: file: actor.safetensors: found other contents"),
    ):
        (tmp_path / name).write_bytes(b"PK\3\4\0\0")
        refused(f"^{message}", evaluate, name)


class Seeing:
    """Does nothing, but only with as many observations as it wants."""

    def __init__(self, frames):
        self.frames = frames

    def predict(self, observations):
        assert observations.shape[1] == 6 * self.frames
        return np.zeros((len(observations), 3))


def test_policies_may_have_own_labels_and_histories():
    own = Seeing(40)
    own.needs = Needs(history=40)
    given = [
        {"TD3 + BC": Seeing(1), "long": Seeing(3), "own": own},
        "constant",
        {"constant": {"kind": "bad"}},
    ]
    found = evaluate(given, history={"long": 3}, steps=3, episodes=2)
    assert [r.policy for r in found.results] == ["TD3 + BC", "long", "own", "constant", "constant-2"]
    assert (found.returns[:3] == found.returns[3]).all()


def test_messages_have_the_label_that_was_given():
    with pytest.raises(PolicyError, match=r"^policy my own: asked about random observations: step 0: "):
        evaluate({"my own": lambda seen: seen[:, :2]}, steps=3, episodes=2)
    with pytest.raises(ConfigError, match=r"^history: a: history: found 20000, expected a whole number"):
        evaluate({"a": len}, history={"a": 20_000})


ALIKE = {"setpoint": 20, "steps": 12, "episodes": 3, "seed": 4}
TROUBLES = {"delay": {"obs_fatigue": 2}, "missing": {"obs_velocity": 0.3}, "noise": {"obs_gain": 1.0}}


class Watcher:
    """Remembers what it was given at each step, and always acts in the same way."""

    def __init__(self):
        self.seen = {}

    def decide(self, given):
        self.seen[int(given.step[0])] = given.observations.copy()  # the last time it is asked
        return np.tile([[0.5, -0.25, 0.125]], (len(given.step), 1)), given.memory


def watched(**given):
    """What an object saw (steps, episodes, frames, numbers of a frame), and the evaluation."""
    watcher = Watcher()
    found = ibdata.evaluate(watcher, **ALIKE, **given)
    return np.stack([watcher.seen[step] for step in range(ALIKE["steps"])]), found


def test_an_object_sees_the_whole_state_and_its_actions():
    plain, _ = watched()
    now, _ = watched(view={"observe": "markov", "actions": True}, history=2)
    assert now.shape == (12, 3, 2, 23)
    assert (now[:, :, 0, :6] == plain[:, :, 0]).all()
    assert (now[1:, :, 1] == now[:-1, :, 0]).all()
    assert (now[0, :, 1] == now[0, :, 0]).all()
    assert (now[1:, :, 0, 7:15] == now[:-1, :, 0, 6:14]).all()  # θ is a shift register
    assert (now[1:, :, 0, 20:] == np.float32([0.5, -0.25, 0.125])).all()
    assert (now[0, :, 0, 20:] == 0).all()


def test_imperfections_are_those_of_a_dataset_at_the_same_step():
    """From the first observation on, which is pushed once."""
    plain, _ = watched()
    seen, _ = watched(view={"imperfections": TROUBLES})
    measurement = Measurement(imperfections_of(TROUBLES), OBSERVED)
    for number in range(ALIKE["episodes"]):
        expected, _ = measurement.episode(plain[:, number, 0], number)
        assert seen[:, number, 0].tolist() == expected.tolist()


def test_rewards_are_weighted_as_in_a_dataset():
    """Each reward is that of the frame after the action; the last frame is not seen."""
    frames, _ = watched()
    shorter = {**ALIKE, "steps": 11, "discount": 1.0}
    found = ibdata.evaluate(Watcher(), **shorter, view={"reward": {"consumption": 0.5, "fatigue": 2}})
    costs = frames[1:, :, 0].astype(float)
    rewards = -(0.5 * costs[:, :, 5] + 2 * costs[:, :, 4]).astype(np.float32)
    assert found.returns[0, 0] == pytest.approx(rewards.sum(axis=0, dtype=float), rel=1e-12)
    assert found.results[0].score is None
    assert found.notes == ["no score: optimized is made for the classic reward"]
    change = ibdata.evaluate(Watcher(), **shorter, view={"reward": "delta"}).returns[0, 0]
    cost = frames[[0, -1], :, 0, 5].astype(float) + 3.0 * frames[[0, -1], :, 0, 4]
    assert change == pytest.approx(cost[0] - cost[1], abs=1e-4)


def test_a_view_that_nobody_could_see_or_an_object_within_another_policy_is_refused():
    """Also beside an object that sees it."""
    with pytest.raises(UsageError, match="view: found one, but no object that could see it"):
        ibdata.evaluate("safe", **ALIKE, view={"observe": "markov"})
    within = {"kind": "epsilon_greedy", "base": Watcher(), "epsilon": 0.1}
    for given in ([Watcher(), within], {"a": Watcher(), "b": {"kind": "mixture", "bases": ["safe", within]}}):
        with pytest.raises(UsageError, match=r"^view: found (epsilon_greedy|b), an object within"):
            ibdata.evaluate(given, **ALIKE, view={"observe": "markov"})
    ibdata.evaluate([Watcher(), within], **ALIKE, view={"reward": "delta"})  # which all get


def test_a_density_cannot_change_the_actions_that_are_stored(tmp_path):
    class Changing(Uniform):
        def log_density(self, action):
            action[:] = 0.25
            return np.zeros(len(action))

    class Noisy:
        needs = Needs(draws=3)

        def decide(self, observed):
            return Decision(Changing(), observed.memory)

    with pytest.raises(PolicyError, match="read-only"):
        ibdata.generate({"name": "x", "setpoints": 50, "policies": [Noisy()], "steps": 5}, out=tmp_path / "x")
