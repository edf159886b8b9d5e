"""The observations that a policy gets, and the use of its actions."""

from __future__ import annotations

import itertools
from typing import Literal

import numpy as np
import pytest

import ibdata
from ibdata._simulation.carry import begin
from ibdata._simulation.episodes import record_rows
from ibdata._simulation.unroll import unroll
from ibdata.errors import PolicyError
from ibdata.experiment import Experiment
from ibdata.experiment.rollout import episodes_of, rollout
from ibdata.policies import Decision, Policy

STEPS = 30
RANDOM_AND_SAFE = Experiment(
    name="x", setpoints=[0, 33, 100], policies=["random", "safe"], episodes=2, steps=STEPS, start="uniform"
)


def test_clipped_actions_are_counted_once_a_row():
    class Returning(Policy):
        kind: Literal["returning"] = "returning"

        def decide(self, given):
            action = np.zeros((len(given.step), 3))
            action[0], action[1, 2], action[2] = 2.0, -1.5, 1.0
            return Decision(action, given.memory)

    options = {**RANDOM_AND_SAFE.options(), "policies": [Returning()]}
    assert rollout(Experiment.model_construct(**options), 0, 6).clipped == 2 * STEPS
    of_random, of_safe, of_both = (
        rollout(RANDOM_AND_SAFE, first, stop).clipped for first, stop in ((0, 6), (6, 12), (0, 12))
    )
    assert (of_random, of_both) == (0, of_safe)
    assert of_safe > 0


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
