"""`ibdata.testing.check_policy` accepts correct policies and describes the faults of others."""

from __future__ import annotations

from functools import partial
from itertools import count
from typing import ClassVar

import numpy as np
import pytest
from helpers.objects import Sure
from scipy.special import ndtri

from ibdata.errors import PolicyError
from ibdata.policies import ClippedNormal, Decision, Distribution, Needs, Policy, checked
from ibdata.testing import check_policy

FEW = checked.histories(2, 1)  # situations, in each of which 20,000 actions are drawn


class TwoSides(Distribution):
    """0.5 or -0.5 in all three numbers, one as often as the other."""

    draws = 1

    def sample(self, u):
        return np.where(u[:, :1] < 0.5, 0.5, -0.5) * np.ones(3)

    def log_density(self, action):
        return np.where(np.isin(action, (0.5, -0.5)).all(axis=1), np.log(0.5), -np.inf)

    def atoms(self, action):
        return np.abs(action) == 0.5


class Coin(Policy):
    """Up or down, one as often as the other."""

    needs: ClassVar[Needs] = Needs(draws=1)
    kind: str = "coin"
    sides: ClassVar[type] = TwoSides

    def decide(self, given):
        return Decision(self.sides(), given.memory)


class Kept(TwoSides):
    """The side of the first coin of an episode."""

    def __init__(self, step, side):
        self.step, self.side = step, side

    def sample(self, u):
        return np.where(self.step[:, None] == 0, super().sample(u), self.side)

    def log_density(self, action):
        kept = (action == self.side).all(axis=1)
        return np.where(self.step == 0, super().log_density(action), np.where(kept, 0.0, -np.inf))


class Stubborn(Policy):
    """Keeps the side of the first coin of an episode, in its memory."""

    needs: ClassVar[Needs] = Needs(draws=1, memory=1)
    kind: str = "stubborn"
    sides: ClassVar[type] = Kept

    def decide(self, given):
        kept = self.sides(given.step, given.memory)
        return Decision(kept, kept.sample(given.draws)[:, :1])


class Learned:
    """An object with `predict`, which looks at the observation of the step before."""

    def predict(self, observations):
        return observations[:, 6:9] / 100.0, None


@pytest.mark.parametrize("policy", [Stubborn(), Sure(), "safe"])
def test_what_is_right_passes(policy):
    check_policy(policy, FEW)


def test_an_object_that_predicts_passes_with_its_history():
    check_policy(Learned(), history=2)
    message = r"found actions of shape \(32, 0\), .* given observations \(32, 6\)"
    with pytest.raises(PolicyError, match=message):
        check_policy(Learned())


CALLS, ARRAYS = count(), {}


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
    out[:] = TwoSides().sample(given.draws)
    return Decision(out, given.memory)


def peeking(policy, given):
    return Decision(ClippedNormal(given.draws * np.ones(3), 0.1), given.memory)


def same(given, value, size=3, spread=None):
    """A decision of one number for everything."""
    mean = np.full((len(given.step), size), value)
    return Decision(mean if spread is None else ClippedNormal(mean, spread), given.memory)


OTHERS = "for half of the episodes in another order"
DECISIONS = [
    (Coin, changing, "decide changed the observations"),
    (Coin, reusing, "changed an array that an earlier one returned"),
    (Coin, lambda _, given: same(given, next(CALLS) / 10000.0), "when the same was asked again"),
    (Coin, lambda _, given: same(given, given.observations.mean() / 1000.0), OTHERS),
    (Coin, lambda _, given: same(given, 0.0, size=4), r"found actions of shape .*, 4\)"),
    (Coin, lambda _, given: same(given, 0.0, spread=0.1), "a ClippedNormal and needs.draws 1, expected at"),
    (Stubborn, overwriting, "decide changed the memory that it was given"),
    (Stubborn, lambda _, x: same(x, x.memory)._replace(memory=x.memory + x.draws.mean()), OTHERS),
]


@pytest.mark.parametrize(("base", "fault", "message"), DECISIONS)
def test_a_wrong_decision_is_said(base, fault, message):
    with pytest.raises((AssertionError, PolicyError), match=message):
        check_policy(type("Faulty", (base,), {"decide": fault})(), FEW)


def faulty(base, **attributes):
    """A policy like another but for these class attributes."""
    annotations = dict.fromkeys(attributes, ClassVar)
    return type("Faulty", (base,), {**attributes, "__annotations__": annotations, "__module__": __name__})()


def test_a_distribution_of_its_own_draws_is_said():
    policy = faulty(Coin, needs=Needs(draws=3))
    type(policy).decide = peeking
    with pytest.raises(AssertionError, match="depends on the random numbers of its own step"):
        check_policy(policy)


def unknown_elsewhere(self, action):
    """Right at the actions that are drawn, NaN where nobody would look."""
    return np.where((np.abs(action) == 0.5).all(axis=1), np.log(0.5), np.nan)


DENSITIES = [
    (Coin, lambda self, action: np.full(len(action), -np.inf), "finite at the policy's own actions"),
    (Coin, lambda self, action: np.where(action[:, 0] == 0.5, -0.7, np.inf), "the log density inf at"),
    (Coin, lambda self, action: np.zeros((len(action), 1)), r"log densities of shape .2, 1."),
    (Coin, lambda self, action: TwoSides.log_density(self, action) - 0.2, "the probability 0.4094, but its"),
    (Coin, unknown_elsewhere, "expected a number below inf"),
    (Stubborn, TwoSides.log_density, "the probability 0.5000, but its share of 20000 draws was 1.0000"),
]


@pytest.mark.parametrize(("base", "density", "message"), DENSITIES)
def test_a_wrong_density_is_said(base, density, message):
    sides = type("Wrong", (base.sides,), {"log_density": density})
    with pytest.raises((AssertionError, PolicyError), match=message):
        check_policy(faulty(base, sides=sides), FEW)


CORRELATED = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]]).T


def exponential(u):
    return -1.0 - 0.35 * np.log(u[:, :3])


def correlated(u):
    return 0.3 * ndtri(u[:, :3]) @ CORRELATED


def log_normal(deviation, action):
    return (-0.5 * (action / deviation) ** 2 - np.log(deviation) - 0.5 * np.log(2.0 * np.pi)).sum(axis=1)


def log_correlated(action):
    return log_normal(0.3, action @ np.linalg.inv(CORRELATED)) - np.log(0.8)


def log_constant(action):
    """In the middle half it has the integral of the exponential distribution, and 17.6 over the cube."""
    return np.full(len(action), 3.0 * np.log(0.5 / (0.35 * np.log(3.0))))


def log_exponential(action):
    return (-(action + 1.0) / 0.35 - np.log(0.35)).sum(axis=1)


SHAPES = {
    "exponential": (exponential, log_exponential, log_constant),
    "correlated": (correlated, log_correlated, partial(log_normal, 0.3)),
}


@pytest.mark.parametrize(("draw", "right", "wrong"), SHAPES.values(), ids=SHAPES)
def test_a_density_of_another_shape_is_said(draw, right, wrong):
    """It agrees in the middle, or nearly; the right one passes, also if it is narrow and wide at once."""

    def policy(stated):
        class Stated(Distribution):
            draws = 4
            sample = staticmethod(draw)

            def log_density(self, action):
                edge = -5.0 * (np.abs(action) == 1.0).any(axis=1)  # where few are clipped
                return stated(action.astype(np.float64)) + edge

        return faulty(Coin, needs=Needs(draws=4), sides=Stated)

    check_policy(policy(right), FEW)
    with pytest.raises(AssertionError, match=r"log_density (is not that of the draws: if|gives actions)"):
        check_policy(policy(wrong), FEW)


class ForgetsClipping(ClippedNormal):
    """States the density of a normal distribution at ±1 too."""

    def log_density(self, action):
        z = (action - self.mean) / self.sd
        return (-0.5 * z**2 - np.log(self.sd) - 0.5 * np.log(2.0 * np.pi)).sum(axis=1)


class ForgetsAtoms(ClippedNormal):
    def atoms(self, action):
        return np.zeros(action.shape, dtype=bool)


@pytest.mark.parametrize("distribution", [ForgetsClipping, ForgetsAtoms])
def test_where_some_numbers_are_clipped_they_are_counted_too(distribution):
    """Few actions are clipped in all three numbers, so those clipped in one or two are counted."""

    class Noisy:
        needs = Needs(draws=3)

        def decide(self, observed):
            mean = np.clip(observed.observations[:, 0, 1:4] / 50.0 - 1.0, -0.5, 0.5)
            return Decision(distribution(mean, 0.5), observed.memory)

    with pytest.raises(AssertionError, match=r"log_density gives|atoms gives"):
        check_policy(Noisy())
