"""`ibdata.testing.check_policy` accepts correct policies and describes the faults of others."""

from __future__ import annotations

from itertools import count
from typing import ClassVar

import numpy as np
import pytest

from ibdata.errors import PolicyError
from ibdata.policies import POLICIES, Decision, Deterministic, Needs, Policy
from ibdata.testing import check_policy


class Coin(Policy):
    """Up or down, one as often as the other."""

    needs: ClassVar[Needs] = Needs(step_draws=1)
    kind: str = "coin"

    def decide(self, given):
        u = given.uniforms
        return Decision(np.where(u < 0.5, 0.5, -0.5) * np.ones(3), given.memory)

    def log_density(self, given, action):
        return np.where(np.isin(action, (0.5, -0.5)).all(axis=1), np.log(0.5), -np.inf)


class Stubborn(Policy):
    """Keeps the side of the first coin of an episode, in its memory."""

    needs: ClassVar[Needs] = Needs(step_draws=1, memory=1)
    kind: str = "stubborn"

    def decide(self, given):
        drawn = np.where(given.uniforms < 0.5, 0.5, -0.5)
        side = np.where(given.step[:, None] == 0, drawn, given.memory)
        return Decision(side * np.ones(3), side)

    def log_density(self, given, action):
        first, kept = given.step == 0, (action == given.memory).all(axis=1)
        valid = np.isin(action, (0.5, -0.5)).all(axis=1) & (action[:, :1] == action).all(axis=1)
        return np.where(first, np.where(valid, np.log(0.5), -np.inf), np.where(kept, 0.0, -np.inf))


class Still(Policy):
    """Has no density."""

    kind: str = "still"

    def decide(self, given):
        return Decision(np.zeros((len(given.step), 3)), given.memory)


class Sure(Still, Deterministic):
    """Says that its action is certain."""

    kind: str = "sure"


class Learned:
    """An object with `predict`, which looks at the observation of the step before."""

    def predict(self, observations):
        return observations[:, 6:9] / 100.0, None


@pytest.mark.parametrize(
    "policy",
    [Coin(), Stubborn(), Still(), Sure(), POLICIES["gaussian"](base={"kind": "bad"}, scale=0.5), "safe"],
)
def test_what_is_right_passes(policy):
    check_policy(policy)


def test_an_object_that_predicts_passes_with_its_history():
    check_policy(Learned(), history=2)
    with pytest.raises(
        PolicyError, match=r"found actions of shape \(32, 0\), .* given observations \(32, 6\)"
    ):
        check_policy(Learned())


CALLS, ARRAYS, SIDES = count(), {}, {}


def changing(policy, given):
    given.observations[:] = 0.0
    return Coin.decide(policy, given)


def overwriting(policy, given):
    answer = Stubborn.decide(policy, given)
    given.memory[:] = answer.memory + 1.0
    return answer


def reusing(policy, given):
    n = len(given.step)
    out = ARRAYS.setdefault(n, np.empty((n, 3)))
    out[:] = Coin.decide(policy, given).actions
    return Decision(out, given.memory)


def counting(policy, given):
    return Decision(np.full((len(given.step), 3), next(CALLS) / 10000.0), given.memory)


def depending_on_others(policy, given):
    others = given.observations[:, 0].mean() / 1000.0
    return Decision(Coin.decide(policy, given).actions - others, given.memory)


def remembering(policy, given):
    """Begins an episode with the side of the last one, which it keeps outside of its memory."""
    _, side = Stubborn.decide(policy, given)
    before = SIDES.setdefault(len(side), side)
    SIDES[len(side)] = side
    return Decision(np.where(given.step[:, None] == 0, before, side) * np.ones(3), side)


def shared(policy, given):
    actions, side = Stubborn.decide(policy, given)
    return Decision(actions, side + given.uniforms.mean())


def constant(value, size=3):
    return lambda policy, given: Decision(np.full((len(given.step), size), value), given.memory)


def surprised(policy, given, action):
    """Says that every action is as likely as at the first step."""
    return Stubborn.log_density(policy, given._replace(step=0 * given.step), action)


def peeking(policy, given, action):
    return Stubborn.log_density(policy, given, action) - given.uniforms[:, 0]


def unlikely(policy, given, action):
    return Coin.log_density(policy, given, action) - 0.2


def single(policy, given, action):
    return Coin.log_density(policy, given, action).astype(np.float32)


def peak(policy, given, action):
    return np.where(np.isin(action, (0.5, -0.5)).all(axis=1), np.log(0.5), np.inf)


def infinite(policy, given, action):
    return np.full(len(action), -np.inf)


FAULTS = [
    (Coin, "decide", changing, "decide changed the observations"),
    (Coin, "decide", reusing, "changed an array that an earlier one returned"),
    (Coin, "decide", counting, "when the same was asked again"),
    (Coin, "decide", depending_on_others, "for the same episodes in another order"),
    (Coin, "decide", constant(0.0, size=4), r"found actions of shape .*, 4\)"),
    (Coin, "decide", constant(np.nan), "expected finite numbers"),
    (Stubborn, "decide", overwriting, "decide changed the memory that it was given"),
    (Stubborn, "decide", remembering, "for the same episodes in another order"),
    (Stubborn, "decide", shared, "for the same episodes without half of them"),
    (Coin, "log_density", infinite, "finite at the policy's own actions"),
    (Coin, "log_density", peak, r"log_density is \[inf\] at"),
    (Coin, "log_density", single, "must return float64"),
    (Coin, "log_density", unlikely, "the probability 0.4094, but its share of 2000 draws was 0.[45]"),
    (Stubborn, "log_density", peeking, "depends on the random numbers of its own step"),
    (Stubborn, "log_density", surprised, "the probability 0.5000, but its share of 2000 draws was 1.0000"),
]


@pytest.mark.parametrize(("base", "method", "fault", "message"), FAULTS)
def test_what_is_wrong_is_said(base, method, fault, message):
    policy = type("Faulty", (base,), {method: fault})()
    with pytest.raises((AssertionError, PolicyError), match=message):
        check_policy(policy)
