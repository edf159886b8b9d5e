"""Each distribution draws by its density: draws are counted, and the integral over all actions is 1."""

from __future__ import annotations

import numpy as np
import pytest
from policies.test_recount import SIGMAS, N, recounted

from ibdata.policies import Certain, ClippedNormal, Uniform
from ibdata.policies.distributions import ByRow, Group, applied
from ibdata.policies.network import SquashedNormal
from ibdata.policies.replaced import OrCertain, OrUniform

MEAN, SD = np.array([0.7, -0.2, 0.1]), np.array([0.5, 0.9, 0.3])
ACTION = np.array([0.5, -0.25, 0.1])


def normal(n, sd=SD):
    return ClippedNormal(np.tile(MEAN, (n, 1)), sd)


def certain(n):
    return Certain(np.tile(ACTION, (n, 1)))


def alternating(n):
    even, odd = np.arange(0, n, 2), np.arange(1, n, 2)
    return ByRow([Group(even, normal(len(even)), 3), Group(odd, normal(len(odd)), 3)], draws=3)


CASES = {
    "certain": certain,
    "uniform": lambda n: Uniform(),
    "clipped normal": normal,
    "normal or uniform": lambda n: OrUniform(np.full(n, 0.3), normal(n), first=3),
    "normal or certain": lambda n: OrCertain(np.full(n, 0.4), normal(n), certain(n), first=3),
    "certain or uniform": lambda n: OrUniform(np.full(n, 0.3), certain(n), first=0),
    "nested": lambda n: OrUniform(np.full(n, 0.2), CASES["certain or uniform"](n), first=4),
    "by row": alternating,
    "squashed": lambda n: SquashedNormal(np.tile([*MEAN, -0.5, -0.2, -1.0], (n, 1)), 0.6, by_tanh=True),
}


@pytest.mark.parametrize("make", CASES.values(), ids=CASES)
def test_draws_are_as_frequent_as_the_density_says(make):
    distribution = make(N)
    actions = applied(distribution.sample(np.random.default_rng(4).random((N, distribution.draws))))
    expected, counted = recounted(lambda x: np.exp(make(len(x)).log_density(x)), actions)
    assert expected.sum() == pytest.approx(1.0, abs=1e-3)
    error = np.sqrt((expected * (1.0 - expected) + 1.0 / N) / N)
    assert (np.abs(counted - expected) / error).max() < SIGMAS


def test_atoms_of_a_mixture_are_those_of_its_parts():
    edge, inside = np.array([[1.0, 0.0, 0.0]], np.float32), ACTION[None].astype(np.float32)
    greedy = CASES["certain or uniform"](1)
    assert greedy.atoms(inside).all()
    assert not greedy.atoms(edge).any()
    repeated = CASES["normal or certain"](1)
    assert repeated.atoms(edge).tolist() == [[True, False, False]]
    assert repeated.atoms(inside).all()


@pytest.mark.parametrize(
    ("mean", "sd", "message"),
    [
        (np.zeros((4, 3)), 0.0, "found the standard deviation 0.0, expected a number above 0"),
        (np.zeros((4, 3)), [0.1, 0.1, -0.5], "found the standard deviation -0.5"),
        (np.zeros((4, 3)), np.nan, "found the standard deviation nan"),
        (np.zeros((4, 2)), 0.1, r"found means of shape \(4, 2\), expected \(4, 3\)"),
        (
            np.zeros((4, 3)),
            np.ones((2, 3)),
            r"found deviations of shape \(2, 3\), expected a number, \(n, 1\)",
        ),
        (np.zeros((4, 3)), np.ones(4), r"found deviations of shape \(4,\)"),
    ],
)
def test_a_normal_distribution_that_is_none_is_refused(mean, sd, message):
    with pytest.raises(ValueError, match=message):
        ClippedNormal(mean, sd)


def test_a_distribution_of_other_episodes_is_refused():
    action, u = np.zeros((5, 3), np.float32), np.full((5, 3), 0.5)
    for call in (
        lambda: normal(4).log_density(action),
        lambda: normal(6).sample(u),
        lambda: certain(4).log_density(action),
    ):
        with pytest.raises(ValueError, match=r"of shape \([46], 3\), expected \(5, 3\)"):
            call()
