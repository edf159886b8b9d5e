"""The observations that a policy gets, and the use of its actions."""

from __future__ import annotations

import itertools
from typing import ClassVar, Literal

import numpy as np
import pytest

import ibdata
from ibdata.errors import PolicyError
from ibdata.experiment import Experiment
from ibdata.experiment.rollout import episodes_of, rollout
from ibdata.policies import Decision, Distribution, Policy
from ibdata.policies.baselines import OBSERVATION_MEAN, OBSERVATION_STD
from ibdata.simulation.carry import begin
from ibdata.simulation.unroll import unroll
from ibdata.simulation.variables import record_rows

OBSERVATION = ("setpoint", "velocity", "gain", "shift", "fatigue", "consumption")
STEPS = 30


def described(**changes):
    plain = {
        "name": "tested",
        "setpoints": [0.0, 33.0, 100.0],
        "policies": [{"kind": "random"}, {"kind": "safe"}],
        "episodes": 2,
        "steps": STEPS,
        "start": "uniform",
        "output": {"dtype": "float64"},
    }
    return Experiment.model_validate({**plain, **changes})


def with_policies(*policies, **changes):
    return Experiment.model_construct(**{**described(**changes).options(), "policies": list(policies)})


def played(experiment):
    """The columns by name, each (episodes, steps)."""
    made = rollout(experiment, 0, len(experiment.cells) * experiment.episodes)
    return {name: x.reshape(-1, STEPS) for name, x in zip(made.names, made.table, strict=True)}


class Stated(Distribution):
    """Actions with the density that the test gives."""

    def __init__(self, actions, density):
        self.actions, self.density = actions, density

    def sample(self, u):
        return self.actions

    def log_density(self, action):
        return self.density(len(action))


class Returning(Policy):
    """The answers that the test gives."""

    answer: ClassVar[object] = None
    density: ClassVar[object] = staticmethod(np.zeros)

    kind: Literal["returning"] = "returning"

    def decide(self, given):
        return Decision(Stated(self.answer(len(given.step)), self.density), given.memory)


def test_a_policy_around_another_sees_the_bases_frames(monkeypatch):
    """What optimized does of the stored observations, k steps ago or the first; by the printed formula."""
    monkeypatch.setattr("ibdata.simulation.unroll.BLOCK", 4)
    greedy = {"kind": "epsilon_greedy", "base": {"kind": "optimized"}, "epsilon": 0.5}
    made = played(described(policies=[greedy, {"kind": "optimized"}], output={"dtype": "float32"}))
    z = {
        name: (made[f"obs_{name}"].astype(np.float64) - mean) / std
        for name, mean, std in zip(OBSERVATION, OBSERVATION_MEAN, OBSERVATION_STD, strict=True)
    }
    now = np.arange(STEPS)
    p, v, f, h3, h4 = (
        z[name][:, np.maximum(0, now - k)]
        for name, k in (("setpoint", 0), ("velocity", 5), ("fatigue", 3), ("shift", 3), ("shift", 4))
    )
    proposed = np.stack([-v - 0.91, 2.0 * f - p + 1.43, -3.48 * h3 - h4 + 2.0 * p + 0.81], axis=2)
    base = np.clip(proposed, -1.0, 1.0).astype(np.float32)
    action = np.stack([made[f"act_{name}"] for name in ("velocity", "gain", "shift")], axis=2)
    same = (action == base).all(axis=2)
    assert same[6:].all()
    assert 0.3 < same[:6].mean() < 0.7  # 180 actions: ½ ± 5.4 standard errors
    density = made["action_log_prob"][:6]
    assert (density[same[:6]] == np.float32(np.log(0.5))).all()
    assert (density[~same[:6]] < np.log(0.5 / 8) + 1e-6).all()


def test_a_density_of_another_shape_is_an_error(monkeypatch):
    monkeypatch.setattr(Returning, "answer", staticmethod(lambda n: np.zeros((n, 3))))
    monkeypatch.setattr(Returning, "density", staticmethod(lambda n: np.zeros((6, 3))))
    with pytest.raises(PolicyError, match=r"^policy returning: episode 0: step 0: "):
        rollout(with_policies(Returning()), 0, 6)


@pytest.mark.parametrize(
    "answer", [lambda n: [[1, 0, -1]] * n, lambda n: np.array([[1e300, -1e-60, -1.0000001]] * n)]
)
def test_actions_in_any_form_are_clipped_and_rounded(monkeypatch, answer):
    monkeypatch.setattr(Returning, "answer", staticmethod(answer))
    made = played(with_policies(Returning()))
    expected = [np.full((6, STEPS), x) for x in (1.0, 0.0, -1.0)]
    for name, values in zip(("act_velocity", "act_gain", "act_shift"), expected, strict=True):
        assert made[name].tobytes() == values.tobytes()


def test_clipped_actions_are_counted_once_a_row(monkeypatch):
    def answer(n):
        action = np.zeros((n, 3))
        action[0], action[1, 2], action[2] = 2.0, -1.5, 1.0
        return action

    monkeypatch.setattr(Returning, "answer", staticmethod(answer))
    assert rollout(with_policies(Returning()), 0, 6).clipped == 2 * STEPS
    assert rollout(described(), 0, 6).clipped == 0  # random actions
    assert rollout(described(), 0, 12).clipped == rollout(described(), 6, 12).clipped > 0


@pytest.mark.parametrize(("dynamics", "dtype"), [("siemens", "float32"), ("paper", "float64")])
def test_there_is_no_negative_zero(dynamics, dtype):
    experiment = described(
        dynamics=dynamics,
        setpoints={"drifting": [0.0, 100.0]},
        policies=[{"kind": "constant", "action": (-0.0, 0.0, -0.0)}, {"kind": "random"}],
        episodes=20,
        steps=100,
        start="default",
        output={"dtype": dtype, "latent": "full"},
    )
    table = rollout(experiment, 0, 80).table
    assert (table == 0.0).any()
    assert not ((table == 0.0) & np.signbit(table)).any()


def test_an_error_of_several_steps_names_its_own(monkeypatch):
    """It acts for all lanes of several steps in one call: here episode 1 at step 2 + 3."""
    calls = itertools.count()

    def decide(self, given):
        assert given.observations.shape == (8, 0, 6)
        wrong = (np.arange(8)[:, None] == 1 * 2 + 1) & (next(calls) == 1)
        return Decision(np.where(wrong, np.nan, given.draws), given.memory)

    monkeypatch.setattr("ibdata.simulation.unroll.BLOCK", 4)
    monkeypatch.setattr("ibdata.policies.baselines.Random.decide", decide)
    with pytest.raises(PolicyError, match=r"^policy random: episode 1: step 5: found action \[nan nan nan\]"):
        rollout(ibdata.load("random", ["steps=8"]), 0, 2)


@pytest.mark.parametrize("kind", ["random", "constant"])
def test_many_steps_asked_at_once_are_those_asked_alone(monkeypatch, kind):
    experiment = ibdata.load("random", [f"policies=[{{kind: {kind}}}]", "steps=70"])
    before = rollout(experiment, 0, 3)
    acting = type(experiment.cells[0].policy)
    monkeypatch.setattr(acting, "needs", acting.needs._replace(history=1))
    after = rollout(experiment, 0, 3)
    np.testing.assert_array_equal(after.table, before.table)
    assert after.clipped == before.clipped


NOISY = {"kind": "gaussian", "base": {"kind": "bad"}, "scale": 0.3}
CASES = {
    "safe": {"policies": ["safe"], "dynamics": "paper", "setpoints": {"drifting": [0.5, 50, 99.5]}},
    "uniform": {"policies": [NOISY], "start": "uniform"},
    "sticky": {"policies": [{"kind": "sticky", "base": NOISY, "kappa": 0.5}], "start": {"burn_in": [2, 5]}},
    "mixture": {"policies": [{"kind": "mixture", "bases": ["random", "expert"]}]},
    "memory": {"policies": [{"kind": "ornstein_uhlenbeck"}], "setpoints": {"drifting": [1, 2, 3]}},
}


def recorded(experiment, numbers):
    """What is recorded of these episodes: (variables, steps + 1, n), actions and densities (steps, n, …)."""
    episodes = episodes_of(experiment, np.array(numbers))
    rows = record_rows(["setpoint", "fatigue", "consumption", "reward", "theta_3"])
    [block] = unroll(episodes, begin(episodes), rows, STEPS, densities=True)
    return block.record.transpose(2, 0, 1), block.actions.swapaxes(0, 1), block.log_density.T


@pytest.mark.parametrize("changes", CASES.values(), ids=CASES)
def test_random_subsets_of_lanes_equal_lanes_alone(changes):
    plain = {"name": "x", "setpoints": [0, 30, 70], "episodes": 3, "steps": STEPS}
    experiment = Experiment.model_validate({**plain, **changes})
    total = 3 * len(experiment.cells)
    alone = [recorded(experiment, [number]) for number in range(total)]
    rng = np.random.default_rng(1)
    for _ in range(4):
        numbers = rng.permutation(total)[: rng.integers(1, total + 1)].tolist()
        for kind, together in enumerate(recorded(experiment, numbers)):
            for number, lane in zip(numbers, together, strict=True):
                assert lane.tobytes() == alone[number][kind][0].tobytes()
