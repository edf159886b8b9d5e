"""The density of every policy is recounted from its own draws, with its point masses.

The cube of actions is cut into cells: along each number -1, three intervals, and 1; beside them there are the
whole actions that are drawn again and again. In each cell, the share of N draws is compared with the integral
of the density. The draws are fixed. With 5.5 standard errors, one of 13,000 comparisons fails by chance in
one of 2,000 choices of the draws; a probability of 0.1 that is wrong by 0.02 is found almost surely (at full
size by 0.015).
"""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pandas as pd
import pytest
from helpers import FULL
from helpers.policies import BASE, BLOCKS, SAFE, distribution, drawn, playing, policy_of

from ibdata.policies.distributions import applied

N, STATES, STEP = (50_000, 2, 3) if FULL else (20_000, 1, 3)
SIGMAS = 5.5
CUTS = np.array([-1.0, -0.4, 0.3, 1.0])
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)


@pytest.mark.usefixtures("network_here")
@pytest.mark.parametrize("block", BLOCKS)
def test_the_draws_are_as_frequent_as_the_density_says(block):
    policy = policy_of(block)
    assert errors(policy, policy) < SIGMAS


@pytest.mark.parametrize(
    ("of", "draws"),
    [
        ({"kind": "epsilon_greedy", "base": BASE, "epsilon": 0.3}, {"epsilon": 0.33}),
        ({"kind": "gaussian", "base": BASE, "scale": 0.6}, {"scale": 0.65}),
        ({"kind": "sticky", "base": SAFE, "kappa": 0.4}, {"kappa": 0.43}),
    ],
)
def test_a_wrong_density_of_integral_1_is_found(of, draws):
    assert errors(policy_of({**of, **draws}), policy_of(of)) > SIGMAS


def draws(policy):
    """In a few states, what the policy is given, N times with its own random numbers, and its actions."""
    given = list(playing(policy, STATES, STEP + 1))[STEP][0]
    random = np.random.default_rng(1)
    for i in range(STATES):
        many = given.apply(lambda x, i=i: np.repeat(x[i : i + 1], N, axis=0))
        many = many._replace(draws=random.random(many.draws.shape))
        yield many, applied(drawn(policy, many))


def errors(policy, of):
    """How many standard errors the draws of a policy are from a density, which has the integral 1."""
    worst = 0.0
    for many, actions in draws(policy):

        def density(action, many=many):
            some = np.resize(np.arange(N), len(action))
            return np.exp(distribution(of, many.apply(lambda x: x[some])).log_density(action))

        expected, counted = recounted(density, actions)
        assert expected.sum() == pytest.approx(1.0, abs=1e-3)
        error = np.sqrt((expected * (1.0 - expected) + 1.0 / N) / N)
        worst = max(worst, float((np.abs(counted - expected) / error).max()))
    return worst


def recounted(density, actions):
    """The integral of a density over each cell and at each whole action, and their shares of the draws."""
    counted = pd.DataFrame(actions).value_counts()
    found, counts = np.array(counted.index.to_list(), np.float32), counted.to_numpy()
    often = (counts > 5) & (np.abs(found) < 1.0).any(axis=1)
    whole = found[often]
    alone = ~(actions[:, None] == whole).all(axis=2).any(axis=1)
    cells = np.where(np.abs(actions) == 1.0, 3 + (actions > 0), np.searchsorted(CUTS[1:-1], actions))
    shares = np.zeros((5, 5, 5))
    np.add.at(shares, tuple(cells[alone].T), 1.0 / len(actions))
    axes = [
        *((0.5 * (b - a) * NODES + 0.5 * (a + b), 0.5 * (b - a) * WEIGHTS) for a, b in pairwise(CUTS)),
        *((np.array([edge]), np.ones(1)) for edge in (-1.0, 1.0)),
    ]
    integrals = np.empty((5, 5, 5))
    for cell in product(range(5), repeat=3):
        (x, u), (y, v), (z, w) = (axes[k] for k in cell)
        nodes = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3).astype(np.float32)
        integrals[cell] = density(nodes) @ np.einsum("i,j,k->ijk", u, v, w).ravel()
    return (
        np.append(integrals, density(whole) if len(whole) else []),
        np.append(shares, counts[often] / len(actions)),
    )
