"""Objects that remember: in the ways that ibdata knows, and in secret, which it finds out."""

from __future__ import annotations

import functools
from types import SimpleNamespace
from typing import ClassVar, Literal

import numpy as np
import pytest
from helpers.playing import playing

from ibdata import evaluate
from ibdata.evaluation.policies import policy_of
from ibdata.policies import Policy
from ibdata.policies.checked import PolicyError
from ibdata.policies.given import Decision
from ibdata.policies.ways import AnswerError
from ibdata.testing import check_policy

BACK = 0.15


def kicked(x, u):
    return (1.0 - BACK) * x + 0.2 * (2.0 * u - 1.0)


class Deciding(Policy):
    """Drifts by what it remembers in its memory."""

    uniforms_per_step: ClassVar[int] = 3
    memory_size: ClassVar[int] = 3

    kind: Literal["deciding"] = "deciding"

    def decide(self, given):
        x = kicked(given.memory, given.uniforms)
        return Decision(x, x)


class Resetting:
    """Drifts by what it keeps, and begins anew."""

    uniforms_per_step = 3

    def reset(self, n):
        self.x = np.zeros((n, 3))

    def act(self, history, u):
        self.x = kicked(self.x, u)
        return self.x


class Recurrent:
    """Has a state of two arrays (layers, n, hidden), as RecurrentPPO of sb3-contrib."""

    def __init__(self):
        self.calls = []

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        assert deterministic
        n = len(observation)
        self.calls.append((state is None, episode_start.copy()))
        cell, hidden = state or (np.full((2, n, 3), 9.0), np.full((2, n, 3), 9.0))
        cell, hidden = (np.where(episode_start[:, None], 0.0, x) for x in (cell, hidden))
        cell = 0.9 * cell + 0.001 * observation[:, 1:4]
        hidden = 0.5 * hidden + cell
        return hidden[0] - 0.5, (cell, hidden)


def duck(policy):
    """An object with the `decide` of a policy and nothing else of it."""
    return SimpleNamespace(decide=policy.decide, memory_size=3, uniforms_per_step=3)


def returns(policy, episodes=5, steps=12, **settings):
    return evaluate(policy, 70.0, episodes=episodes, steps=steps, **settings).returns[0, 0]


@pytest.mark.parametrize(
    "make", [Resetting, Recurrent, lambda: duck(Deciding())], ids=["reset", "state", "decide"]
)
def test_what_is_remembered_in_the_open_is_the_same_in_any_block(make, monkeypatch):
    policy = make()
    together = returns(policy)
    assert len(set(together.tolist())) == 5
    monkeypatch.setattr("ibdata.simulation.rollout.LANES", 2)
    assert returns(policy).tolist() == returns(make()).tolist() == together.tolist()
    check_policy(policy)


def test_reset_and_memory_drift_in_the_same_way():
    own = {"decide": Deciding().decide, "memory_size": 3, "uniforms_per_step": 3}
    other = type("Resetting", (), {**own, "decide": lambda _, given: own["decide"](given)})
    assert returns(other()).tolist() == returns(Resetting()).tolist()


def test_a_state_is_that_of_the_step_before_and_none_at_the_start():
    policy = Recurrent()
    returns(policy, steps=4)
    assert all(is_none == bool(start.all()) == bool(start.any()) for is_none, start in policy.calls)
    firsts = [is_none for is_none, _ in policy.calls]
    assert firsts == [True] * 4 + [False, True, False, False]


@pytest.mark.parametrize(
    ("predict", "names"),
    [
        (lambda seen, **given: (seen[:, 1:4] / 100.0, given), set()),
        (
            lambda seen, deterministic=False: (seen[:, 1:4] / 100.0, {"deterministic": deterministic}),
            {"deterministic"},
        ),
        (lambda seen, *, episode_start: (seen[:, 1:4] / 100.0, {"episode_start": True}), {"episode_start"}),
    ],
)
def test_keywords_are_given_only_where_the_signature_has_them(predict, names):
    given = []

    def keep(actions, options):
        given.append(options)
        return actions

    wrapped = functools.wraps(predict)(lambda *seen, **options: keep(*predict(*seen, **options)))
    returns(SimpleNamespace(predict=wrapped), steps=2)
    assert {frozenset(options) for options in given} == {frozenset(names)}
    assert {options.get("deterministic", True) for options in given} == {True}


@pytest.mark.parametrize("name", ["state", "deterministic", "episode_start"])
def test_the_first_parameter_is_the_observations_whatever_its_name(name):
    predict = eval(f"lambda {name}: {name}[:, 1:4] / 100.0")
    assert returns(predict).tolist() == returns(lambda seen: seen[:, 1:4] / 100.0).tolist()


def test_a_reset_that_takes_nothing_is_called_too():
    class Lazy(Resetting):
        def reset(self):
            self.x = np.zeros((1, 3))

    Lazy.__name__ = "Resetting"  # which gives it the same random numbers
    assert returns(Lazy()).tolist() == returns(Resetting()).tolist()


class Leaking(Resetting):
    """Begins anew only once."""

    reset = None
    x = np.zeros((1, 3))


class Turning:
    """Remembers the last observation, which it has not at the first step of all."""

    last = None

    def predict(self, observations):
        before, self.last = self.last, observations.copy()
        return 0.1 + observations[:, 1:4] - (observations if before is None else before)[:, 1:4].mean(axis=0)


class Holding:
    """Draws a new action itself every 20 calls."""

    calls = 0

    def predict(self, observations):
        if self.calls % 20 == 0:
            self.action = np.random.default_rng(self.calls).random(3)
        self.calls += 1
        return np.tile(self.action, (len(observations), 1))


class HalfResetting(Resetting):
    """Draws what it draws itself, and forgets only the rest."""

    random = np.random.default_rng(0)

    def act(self, history, u):
        return super().act(history, self.random.random(u.shape))


class Seeding(Resetting):
    """Draws the same for every block of episodes."""

    def reset(self, n):
        super().reset(n)
        self.random = np.random.default_rng(0)

    def act(self, history, u):
        return super().act(history, self.random.random(u.shape))


class Mixing:
    """Acts by the mean of all episodes."""

    def predict(self, observations):
        return observations[:, 1:4] / 100.0 + 0.1 * np.arange(len(observations))[:, None]


AGAIN = "found other actions when the same was asked again, expected equal ones"
ORDER = "found other actions for the same episodes in another order"


@pytest.mark.parametrize(
    ("policy", "step", "line"),
    [
        (Leaking, 0, AGAIN),
        (Turning, 1, AGAIN),
        (Holding, 100, AGAIN),
        (HalfResetting, 0, AGAIN),
        (Seeding, 0, ORDER),
        (Mixing, 0, ORDER),
        (lambda: lambda seen: np.random.default_rng().random((len(seen), 3)), 0, AGAIN),
        (lambda: lambda seen: np.random.default_rng(0).random((len(seen), 3)), 0, ORDER),
    ],
)
@pytest.mark.parametrize("episodes", [1, 3])
def test_what_remembers_or_draws_in_secret_is_found_out(policy, step, line, episodes):
    with pytest.raises(PolicyError, match=rf"episode 0: step {step}: {line}.*random numbers must come from"):
        returns({"mine": policy()}, episodes=episodes, steps=101)


def test_an_object_that_keeps_the_number_of_episodes_is_told_how_to_learn_it():
    class Keeping(Resetting):
        reset = None

        def act(self, history, u):
            if not hasattr(self, "x"):
                Resetting.reset(self, len(u))
            return self.x

    line = r"it returned \(1, 3\); expected \(2, 3\), when asked again; memory must be returned by decide"
    with pytest.raises(PolicyError, match=line):
        returns(Keeping(), episodes=1)


def test_the_last_bits_may_depend_on_the_place_in_the_block():
    """As sums of BLAS and torch do, and an action on the edge may even flip."""

    def rounded(seen):
        place = np.arange(len(seen))[:, None]
        return seen[:, 1:4] / 100.0 + 1e-6 * place + (place == 1)

    assert len(returns(rounded)) == 5


@pytest.mark.parametrize("steps", [[5, 5, 5, 5], [2, 2, 2, 3], [0, 0, 0, 1], [2, 2]], ids=str)
@pytest.mark.parametrize("make", [Resetting, Recurrent])
@pytest.mark.parametrize("asked", [0, 2])
def test_steps_out_of_order_are_refused_where_the_object_remembers(make, steps, asked):
    policy = policy_of(make())
    questions = [given for given, _ in playing(policy, 4, 2)]
    policy = policy_of(make())
    for given in questions[:asked]:
        once, again = policy.decide(given), policy.decide(given)
        assert np.array_equal(once.actions, again.actions)
    wrong = questions[0].apply(lambda x: x[: len(steps)])._replace(step=np.array(steps))
    line = f"found a question about step {steps[0]}, expected the steps of the same episodes in order"
    with pytest.raises(AnswerError, match=line):
        policy.decide(wrong)
