"""What distributions refuse, and their point masses. `test_recount` counts their draws."""

from __future__ import annotations

import numpy as np
import pytest

from ibdata.policies import Certain, ClippedNormal
from ibdata.policies.replaced import OrCertain, OrUniform

MEAN, SD = np.array([0.7, -0.2, 0.1]), np.array([0.5, 0.9, 0.3])
ACTION = np.array([0.5, -0.25, 0.1])


def normal(n, sd=SD):
    return ClippedNormal(np.tile(MEAN, (n, 1)), sd)


def certain(n):
    return Certain(np.tile(ACTION, (n, 1)))


def test_atoms_of_a_mixture_are_those_of_its_parts():
    edge, inside = np.array([[1.0, 0.0, 0.0]], np.float32), ACTION[None].astype(np.float32)
    greedy = OrUniform(np.full(1, 0.3), certain(1), first=0)
    assert greedy.atoms(inside).all()
    assert not greedy.atoms(edge).any()
    repeated = OrCertain(np.full(1, 0.4), normal(1), certain(1), first=3)
    assert repeated.atoms(edge).tolist() == [[True, False, False]]
    assert repeated.atoms(inside).all()


@pytest.mark.parametrize(
    ("mean", "sd", "message"),
    [
        (np.zeros((4, 3)), 0.0, "found the standard deviation 0.0, expected a number above 0"),
        (np.zeros((4, 3)), np.nan, "found the standard deviation nan"),
        (np.zeros((4, 2)), 0.1, r"found means of shape \(4, 2\), expected \(4, 3\)"),
        (np.zeros((4, 3)), np.ones((2, 3)), r"found deviations of shape \(2, 3\), expected a number, \(n"),
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
