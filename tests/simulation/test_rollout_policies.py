"""The observations that a policy gets, and the use of its actions."""

from __future__ import annotations

import itertools
from typing import ClassVar, Literal

import numpy as np
import pytest

import ibdata
from ibdata._simulation.carry import begin
from ibdata._simulation.episodes import record_rows
from ibdata._simulation.unroll import unroll
from ibdata.errors import PolicyError
from ibdata.experiment import Experiment
from ibdata.experiment.rollout import episodes_of, rollout
from ibdata.policies import Decision, Distribution, Policy

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


def test_clipped_actions_are_counted_once_a_row(monkeypatch):
    def answer(n):
        action = np.zeros((n, 3))
        action[0], action[1, 2], action[2] = 2.0, -1.5, 1.0
        return action

    monkeypatch.setattr(Returning, "answer", staticmethod(answer))
    assert rollout(with_policies(Returning()), 0, 6).clipped == 2 * STEPS
    assert rollout(described(), 0, 6).clipped == 0  # random actions
    assert rollout(described(), 0, 12).clipped == rollout(described(), 6, 12).clipped > 0


def test_an_error_of_several_steps_names_its_own(monkeypatch):
    """It acts for all lanes of several steps in one call: here episode 1 at step 2 + 3."""
    calls = itertools.count()

    def decide(self, given):
        assert given.observations.shape == (8, 0, 6)
        wrong = (np.arange(8)[:, None] == 1 * 2 + 1) & (next(calls) == 1)
        return Decision(np.where(wrong, np.nan, given.draws), given.memory)

    monkeypatch.setattr("ibdata._simulation.unroll.BLOCK", 4)
    monkeypatch.setattr("ibdata.policies.baselines.Random.decide", decide)
    with pytest.raises(PolicyError, match=r"^policy random: episode 1: step 5: found action \[nan nan nan\]"):
        rollout(ibdata.load("random", ["steps=8"]), 0, 2)


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
