"""What a policy is given at every step, and the use of its actions."""

from __future__ import annotations

import itertools
from typing import ClassVar, Literal

import numpy as np
import pytest

import ibdata
from ibdata._numerics.random import Purpose, integers, stream_key
from ibdata._simulation.carry import begin
from ibdata._simulation.episodes import record_rows
from ibdata._simulation.unroll import unroll
from ibdata.errors import PolicyError
from ibdata.experiment import Experiment
from ibdata.plan.rollout import episodes_of, rollout
from ibdata.policies import Decision, Distribution, Needs, Policy

STEPS = 13
OBSERVATION = ("setpoint", "velocity", "gain", "shift", "fatigue", "consumption")


class Shifted(Distribution):
    """Half of a uniform draw, shifted by a tenth of a total, with a density that says the total."""

    draws = 3

    def __init__(self, total):
        self.total = total

    def sample(self, u):
        return 0.5 * (2.0 * u - 1.0) + 0.1 * self.total[:, None]

    def log_density(self, action):
        return self.total + action[:, 0]


class Recalling(Policy):
    """Records what it is given; counts its steps and sums its actions in its memory."""

    needs: ClassVar[Needs] = Needs(history=3, draws=3, episode_draws=5, memory=2)
    given: ClassVar[list] = []

    kind: Literal["recalling"] = "recalling"

    def decide(self, given):
        self.given.append(given.apply(np.copy))
        step, total = given.memory.T
        shifted = Shifted(total)
        actions = shifted.sample(given.draws)
        return Decision(shifted, np.stack([step + 1.0, total + actions[:, 0]], axis=1))


class Leaking(Recalling):
    """Changes its memory in place."""

    def decide(self, given):
        given.memory[:] = 1.0
        return super().decide(given)


class Short(Recalling):
    """Forgets to return its memory."""

    def decide(self, given):
        return super().decide(given).action


class Narrow(Recalling):
    """Returns too little memory."""

    def decide(self, given):
        return Decision(super().decide(given).action, given.memory[:, :1])


class Neither(Policy):
    kind: Literal["neither"] = "neither"


def described(policy, **changes):
    plain = {"name": "x", "setpoints": [20.0, 70.0], "policies": [{"kind": "random"}], "episodes": 4}
    experiment = Experiment.model_validate(
        {**plain, "steps": STEPS, "output": {"dtype": "float64"}, **changes}
    )
    return Experiment.model_construct(**{**experiment.options(), "policies": [policy]})


def played(experiment, first=0, stop=8):
    made = rollout(experiment, first, stop)
    return {name: x.reshape(-1, STEPS) for name, x in zip(made.names, made.table, strict=True)}


@pytest.fixture
def questions(monkeypatch, small_blocks):
    """The experiment, its columns, and what the policy was given, by field (8 episodes, steps, …)."""
    small_blocks(lanes=3, lane_steps=4)
    monkeypatch.setattr(Recalling, "given", [])
    experiment = described(Recalling())
    made = played(experiment)
    blocks = [Recalling.given[i : i + STEPS] for i in range(0, 3 * STEPS, STEPS)]
    fields = {
        name: np.concatenate([np.stack([getattr(g, name) for g in block], axis=1) for block in blocks])
        for name in Recalling.given[0]._fields
    }
    return experiment, made, fields


def test_the_last_observations_and_actions_come_newest_first(questions):
    _, made, given = questions
    seen = np.stack([made[f"obs_{name}"] for name in OBSERVATION], axis=2).astype(np.float32)
    done = np.stack([made[f"act_{name}"] for name in ("velocity", "gain", "shift")], axis=2)
    assert given["observations"].shape == (8, STEPS, 3, 6)
    assert given["actions"].shape == (8, STEPS, 3, 3)
    for t in range(STEPS):
        for k in range(3):
            assert (given["observations"][:, t, k] == seen[:, max(0, t - k)]).all()
            before = done[:, t - 1 - k] if t > k else np.zeros((8, 3))
            assert (given["actions"][:, t, k] == before).all()


def test_memory_is_what_was_returned_and_zero_at_the_start(questions):
    _, made, given = questions
    assert (given["step"] == np.arange(STEPS)).all()
    assert (given["memory"][:, 0] == 0.0).all()
    assert (given["memory"][:, :, 0] == np.arange(STEPS)).all()
    totals = np.cumsum(made["act_velocity"], axis=1)
    np.testing.assert_allclose(given["memory"][:, 1:, 1], totals[:, :-1], atol=1e-6)
    assert len(np.unique(given["memory"][:, -1, 1])) == 8


def test_random_numbers_of_an_episode_are_at_its_address(questions):
    experiment, _, given = questions
    assert (given["episode_draws"] == given["episode_draws"][:, :1]).all()
    for i, found in enumerate(given["episode_draws"][:, 0]):
        key = stream_key(experiment.seed, experiment.cells[i // 4].digest)[None]
        raw = integers(key, np.array([i % 4]), Purpose.EPISODE_POLICY, 0, 1, 8)[0, :5, 0]
        assert found.tolist() == [((int(x) >> 12) + 0.5) * 2.0**-52 for x in raw]


def test_actions_before_the_first_one_are_those_of_the_burn_in(monkeypatch):
    monkeypatch.setattr(Recalling, "given", [])
    played(described(Recalling(), start={"burn_in": [2, 2]}))
    first = Recalling.given[0]
    velocity, moved = first.observations[:, :, 1].astype(np.float64), first.actions[:, :, 0]
    np.testing.assert_allclose(velocity[:, :-1] - velocity[:, 1:], moved[:, :-1], atol=1e-5)
    assert (moved[:, :2] != 0.0).all()
    assert (moved[:, 2] == 0.0).all()
    assert (first.memory == 0.0).all()
    assert (first.step == 0).all()


@pytest.mark.parametrize(
    ("policy", "message"),
    [
        (Leaking, "ValueError: assignment destination is read-only"),
        (Short, "found Shifted, expected a Decision of a distribution or actions, and memory"),
        (Narrow, r"found memory of shape \(8, 1\), expected memory of shape \(8, 2\)"),
        (Neither, r"found no decide\(observed\), expected one that returns"),
    ],
)
def test_what_is_no_decision_is_an_error_that_names_its_place(policy, message):
    with pytest.raises(PolicyError, match=f"^policy {policy().kind}: episode 0: step 0: .*{message}"):
        rollout(described(policy()), 0, 8)


def test_clipped_actions_are_counted_once_a_row():
    class Returning(Policy):
        kind: Literal["returning"] = "returning"

        def decide(self, given):
            action = np.zeros((len(given.step), 3))
            action[0], action[1, 2], action[2] = 2.0, -1.5, 1.0
            return Decision(action, given.memory)

    assert rollout(described(Returning()), 0, 8).clipped == 2 * STEPS
    made = Experiment(name="x", setpoints=[0, 100], policies=["random", "safe"], start="uniform", steps=30)
    of_random, of_safe, of_both = (rollout(made, *part).clipped for part in ((0, 2), (2, 4), (0, 4)))
    assert of_random == 0 < of_safe == of_both


def test_an_error_of_several_steps_names_its_own(monkeypatch, small_blocks):
    """It acts for all lanes of several steps in one call: here episode 1 at step 2 + 3."""
    calls = itertools.count()

    def decide(self, given):
        assert given.observations.shape == (8, 0, 6)
        wrong = (np.arange(8)[:, None] == 1 * 2 + 1) & (next(calls) == 1)
        return Decision(np.where(wrong, np.nan, given.draws), given.memory)

    small_blocks(lane_steps=4)
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
    [block] = unroll(episodes, begin(episodes), rows, experiment.steps, densities=True)
    return block.record.transpose(2, 0, 1), block.actions.swapaxes(0, 1), block.log_density.T


@pytest.mark.parametrize("changes", CASES.values(), ids=CASES)
def test_random_subsets_of_lanes_equal_lanes_alone(changes):
    plain = {"name": "x", "setpoints": [0, 30, 70], "episodes": 3, "steps": 30}
    experiment = Experiment.model_validate({**plain, **changes})
    total = 3 * len(experiment.cells)
    alone = [recorded(experiment, [number]) for number in range(total)]
    rng = np.random.default_rng(1)
    for _ in range(4):
        numbers = rng.permutation(total)[: rng.integers(1, total + 1)].tolist()
        for kind, together in enumerate(recorded(experiment, numbers)):
            for number, lane in zip(numbers, together, strict=True):
                assert lane.tobytes() == alone[number][kind][0].tobytes()
