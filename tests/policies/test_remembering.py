"""Objects that remember: in the ways that ibdata knows, and in secret, which it finds out before a run."""

from __future__ import annotations

import functools
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.policies import playing, ready
from helpers.remembering import Deciding, Recurrent, Resetting

from ibdata import evaluate
from ibdata.errors import PolicyError
from ibdata.evaluation.policies import as_policy
from ibdata.policies import Decision, checked
from ibdata.policies.checked import AnswerError
from ibdata.testing import check_policy


def returns(policy, episodes=5, steps=12):
    return evaluate(policy, 70.0, episodes=episodes, steps=steps).returns[0, 0].tolist()


def duck():
    """An object with the `decide` of a policy and nothing else of it."""
    return SimpleNamespace(decide=Deciding().decide, needs=Deciding().needs)


@pytest.mark.parametrize("make", [Resetting, Recurrent, duck])
def test_what_is_remembered_is_the_same_in_any_block(make, small_blocks):
    policy = make()
    together = returns(policy)
    assert len(set(together)) == 5
    small_blocks(lanes=2)
    assert returns(policy) == returns(make()) == together
    check_policy(policy, checked.histories(4, 1))


def test_a_state_is_that_of_the_step_before():
    policy = Recurrent()
    returns(policy, steps=4)
    assert all(is_none == bool(start.all()) == bool(start.any()) for is_none, start in policy.calls)
    firsts = [is_none for is_none, _ in policy.calls]
    assert firsts == [*[True, False] * 3, True, True, False, False, False]  # after the checks before a run


@pytest.mark.parametrize(
    ("predict", "names"),
    [
        (lambda seen, **given: (seen[:, 1:4], given), set()),
        (lambda x, deterministic=False: (x[:, 1:4], {"deterministic": deterministic}), {"deterministic"}),
        (lambda seen, *, episode_start: (seen[:, 1:4], {"episode_start": True}), {"episode_start"}),
    ],
)
def test_keywords_are_given_where_the_signature_has_them(predict, names):
    given = []

    @functools.wraps(predict)
    def keeping(*seen, **options):
        actions, found = predict(*seen, **options)
        given.append(found)
        return actions / 100.0

    returns(SimpleNamespace(predict=keeping), steps=2)
    assert {frozenset(options) for options in given} == {frozenset(names)}
    assert {options.get("deterministic", True) for options in given} == {True}


class Leaking(Resetting):
    """Never begins anew."""

    reset = None
    x = np.zeros((1, 3))


class DrawingInDecide(Deciding):
    """Draws itself, in a class like those of ibdata."""

    def decide(self, given):
        return Decision(np.random.default_rng().random((len(given.step), 3)), given.memory)


def normalizing(observations):
    """Acts by the mean and deviation of all episodes, as a BatchNorm that was left in training mode."""
    x = observations[:, 1:4]
    return (x - x.mean(axis=0)) / (x.std(axis=0) + 1e-6)


AGAIN = "found other actions when the same was asked again, expected equal ones"
MIXED = "found other actions for half of the episodes in another order"


@pytest.mark.parametrize(
    ("make", "line"),
    [
        (Leaking, AGAIN),
        (DrawingInDecide, AGAIN),
        (lambda: normalizing, MIXED),
        (lambda: lambda seen: np.random.default_rng().random((len(seen), 3)), AGAIN),
        (lambda: lambda seen: np.random.default_rng(0).random((len(seen), 3)), MIXED),
    ],
)
def test_secrets_are_found_before_a_run(make, line):
    for call in (lambda: returns({"mine": make()}, episodes=1), lambda: check_policy(make())):
        with pytest.raises(PolicyError, match=rf"^policy [a-z]+: {line}.*write a class with act\(history, u"):
            call()


@pytest.mark.parametrize(("asked", "steps"), [(0, [5, 5, 5, 5]), (2, [0, 0, 0, 1]), (2, [2, 2])])
def test_a_remembering_object_is_asked_in_order(asked, steps):
    policy, other = (ready(as_policy(Recurrent())) for _ in range(2))
    questions = [given for given, _ in playing(other, 4, 2)]
    for given in questions[:asked]:
        policy.decide(given)
    wrong = questions[0].apply(lambda x: x[: len(steps)])._replace(step=np.array(steps))
    line = f"found an object that remembers, asked about step {steps[0]}, expected the steps of the same"
    with pytest.raises(AnswerError, match=line):
        policy.decide(wrong)
