"""Objects that remember: in the ways that ibdata knows, and in secret, which it finds out before a run."""

from __future__ import annotations

import functools
from types import SimpleNamespace
from typing import ClassVar, Literal

import numpy as np
import pytest
from helpers.playing import playing

from ibdata import evaluate
from ibdata.errors import PolicyError
from ibdata.evaluation.policies import policy_of
from ibdata.policies import Decision, Needs, Policy
from ibdata.testing import check_policy

BACK = 0.15


def kicked(x, u):
    return (1.0 - BACK) * x + 0.2 * (2.0 * u - 1.0)


class Deciding(Policy):
    """Drifts by what it remembers in its memory."""

    needs: ClassVar[Needs] = Needs(step_draws=3, memory=3)

    kind: Literal["deciding"] = "deciding"

    def decide(self, given):
        x = kicked(given.memory, given.uniforms)
        return Decision(x, x)


class Resetting:
    """Drifts by what it keeps, and begins anew."""

    needs = Needs(step_draws=3)

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
    return SimpleNamespace(decide=policy.decide, needs=policy.needs)


def returns(policy, episodes=5, steps=12, **settings):
    return evaluate(policy, 70.0, episodes=episodes, steps=steps, **settings).returns[0, 0]


@pytest.mark.parametrize(
    "make", [Resetting, Recurrent, lambda: duck(Deciding())], ids=["reset", "state", "decide"]
)
def test_what_is_remembered_in_the_open_is_the_same_in_any_block(make, monkeypatch):
    policy = make()
    together = returns(policy)
    assert len(set(together.tolist())) == 5
    monkeypatch.setattr("ibdata.experiment.rollout.LANES", 2)
    assert returns(policy).tolist() == returns(make()).tolist() == together.tolist()
    check_policy(policy)


def test_reset_and_memory_drift_in_the_same_way():
    own = {"decide": Deciding().decide, "needs": Deciding().needs}
    other = type("Resetting", (), {**own, "decide": lambda _, given: own["decide"](given)})
    assert returns(other()).tolist() == returns(Resetting()).tolist()


def test_a_state_is_that_of_the_step_before_and_none_at_the_start():
    policy = Recurrent()
    returns(policy, steps=4)
    assert all(is_none == bool(start.all()) == bool(start.any()) for is_none, start in policy.calls)
    firsts = [is_none for is_none, _ in policy.calls]
    assert firsts == [True, False, False, False] * (len(firsts) // 4)


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


class Normalizing:
    """Acts by the mean and deviation of all episodes, as a BatchNorm that was left in training mode."""

    def predict(self, observations):
        x = observations[:, 1:4]
        return (x - x.mean(axis=0)) / (x.std(axis=0) + 1e-6)


class DecidingInSecret(Deciding):
    """Draws itself, in a class like those of ibdata."""

    def decide(self, given):
        return Decision(np.random.default_rng().random((len(given.step), 3)), given.memory)


AGAIN = "found other actions when the same was asked again, expected equal ones"
ORDER = "found other actions for the same episodes in another order"
HALF = "found other actions for the same episodes without half of them"


@pytest.mark.parametrize(
    ("policy", "line"),
    [
        (Leaking, AGAIN),
        (Turning, AGAIN),
        (DecidingInSecret, AGAIN),
        (HalfResetting, AGAIN),
        (Seeding, ORDER),
        (Mixing, ORDER),
        (Normalizing, HALF),
        (lambda: lambda seen: np.random.default_rng().random((len(seen), 3)), AGAIN),
        (lambda: lambda seen: np.random.default_rng(0).random((len(seen), 3)), ORDER),
    ],
)
def test_what_remembers_or_draws_in_secret_or_looks_at_the_others_is_refused_before_a_run(policy, line):
    for call in (lambda: returns({"mine": policy()}, episodes=1), lambda: check_policy(policy())):
        with pytest.raises(PolicyError, match=rf"^policy [a-z]+: {line}.*random numbers must come from"):
            call()


def test_an_object_that_keeps_the_number_of_episodes_is_refused():
    class Keeping(Resetting):
        reset = None

        def act(self, history, u):
            if not hasattr(self, "x"):
                Resetting.reset(self, len(u))
            return self.x

    with pytest.raises(
        PolicyError, match=r"found actions of shape \(32, 3\), expected actions of shape \(16, 3\)"
    ):
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
    with pytest.raises(PolicyError, match=line):
        policy.decide(wrong)
