"""The density of every policy is recounted from its own draws, with its point masses.

The cube of actions is cut into cells: along each number -1, three intervals, and 1; beside them there are the
whole actions that are drawn again and again. In each cell, the share of N draws is compared with the integral
of the density. The draws are fixed. With 5.5 standard errors, one of 13,000 comparisons fails by chance in
one of 2,000 choices of the draws; a probability of 0.1 that is wrong by 0.015 is found almost surely.
"""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest
from helpers import networks
from helpers.playing import playing

from ibdata.policies import POLICIES
from ibdata.policies.actions import applied
from ibdata.policies.tensors import written

N, STATES, STEP = 50_000, 4, 3
SIGMAS = 5.5
CUTS = np.array([-1.0, -0.4, 0.3, 1.0])
NODES, WEIGHTS = np.polynomial.legendre.leggauss(20)

BASE = {"kind": "constant", "action": [0.5, -1.0, 0.1]}
NOISE = {"kind": "ornstein_uhlenbeck", "base": BASE, "theta": 0.5, "sigma": 0.6}
NETWORK = {"kind": "network", "file": "actor.safetensors"}
STICKY = {"kind": "sticky", "base": {"kind": "safe"}, "kappa": 0.4}
MINE = "ibdata.policies.{0}:{1}"
POLICIES_TO_RECOUNT = [
    *({"kind": kind} for kind in ("bad", "constant", "expert", "mediocre", "multisine", "optimized", "prbs")),
    {"kind": "random"},
    {"kind": "safe"},
    {"kind": "custom", "target": MINE.format("safe", "Safe"), "uniforms": 5},
    {"kind": "custom", "target": MINE.format("mediocre", "Mediocre"), "deterministic": True},
    NETWORK,
    {"kind": "sampled", "base": NETWORK, "share": 0.4},
    {"kind": "sampled", "base": NETWORK, "share": 1.0},
    {"kind": "gaussian", "base": BASE, "scale": 0.6},
    NOISE,
    {"kind": "coloured_noise", "period": 8},
    {"kind": "epsilon_greedy", "base": BASE, "epsilon": 0.3},
    {"kind": "epsilon_greedy", "base": {"kind": "safe"}, "epsilon": 0.3},
    {"kind": "epsilon_greedy", "base": BASE, "epsilon": 1.0},
    STICKY,
    {"kind": "sticky", "base": {"kind": "epsilon_greedy", "base": BASE, "epsilon": 0.5}, "kappa": 0.4},
    {"kind": "sticky", "base": STICKY, "kappa": 0.5},
    {"kind": "mixture", "bases": [{"kind": "safe"}, {"kind": "bad"}, {"kind": "random"}]},
    {"kind": "mixture", "bases": [{"kind": "bad"}, {"kind": "sticky", "base": NOISE, "kappa": 0.5}]},
    {"kind": "schedule", "stages": [{"base": BASE, "steps": 10, "epsilon": [0.9, 0.1]}]},
    {"kind": "schedule", "stages": [{"base": STICKY, "steps": 10, "epsilon": [0.5, 0.5]}]},
    {"kind": "schedule", "stages": [{"base": {"kind": "bad"}, "steps": 2}, {"base": {"kind": "safe"}}]},
]


def weights():
    """A network whose draws spread over the cube, so that their density can be integrated."""
    tensors = networks.tensors(frames=1, hidden=(4,))
    for name, values in (("mean", [0.3, -0.5, 0.2]), ("log_std", [-1.0, -0.7, -0.9])):
        tensors[f"{name}.bias"] = np.array(values, dtype=np.float32)
        tensors[f"{name}.weight"] *= np.float32(0.1)
    return written(tensors, networks.metadata(1))


def test_every_kind_is_recounted():
    assert {block["kind"] for block in POLICIES_TO_RECOUNT} == set(POLICIES)


@pytest.mark.parametrize("block", POLICIES_TO_RECOUNT, ids=str)
def test_the_draws_have_the_frequencies_that_the_density_says(block, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "actor.safetensors").write_bytes(weights())
    policy = policy_of(block)
    if block["kind"] == "coloured_noise":
        assert all(np.isnan(policy.log_density(many, actions)).all() for many, actions in draws(policy))
    else:
        assert errors(policy, policy) < SIGMAS


@pytest.mark.parametrize(
    ("of", "draws"),
    [
        ({"kind": "epsilon_greedy", "base": BASE, "epsilon": 0.3}, {"epsilon": 0.32}),
        ({"kind": "gaussian", "base": BASE, "scale": 0.6}, {"scale": 0.63}),
        ({"kind": "sticky", "base": {"kind": "safe"}, "kappa": 0.4}, {"kappa": 0.42}),
    ],
    ids=str,
)
def test_a_wrong_density_is_found_although_its_integral_is_1(of, draws):
    assert errors(policy_of({**of, **draws}), policy_of(of)) > SIGMAS


def policy_of(block):
    return POLICIES[block["kind"]](**{key: value for key, value in block.items() if key != "kind"})


def draws(policy):
    """In a few states, what the policy is given, N times with its own random numbers, and its actions."""
    given = list(playing(policy, STATES, STEP + 1))[STEP][0]
    random = np.random.default_rng(1)
    for i in range(STATES):
        many = given.apply(lambda x, i=i: np.repeat(x[i : i + 1], N, axis=0))
        many = many._replace(uniforms=random.random(many.uniforms.shape))
        yield many, applied(policy.decide(many).actions)


def errors(policy, of):
    """How many standard errors the draws of a policy are from a density, which has the integral 1."""
    worst = 0.0
    for many, actions in draws(policy):

        def density(action, many=many):
            some = np.resize(np.arange(N), len(action))
            return np.exp(of.log_density(many.apply(lambda x: x[some]), action))

        expected, counted = recounted(density, actions)
        assert expected.sum() == pytest.approx(1.0, abs=1e-3)
        error = np.sqrt((expected * (1.0 - expected) + 1.0 / N) / N)
        worst = max(worst, float((np.abs(counted - expected) / error).max()))
    return worst


def recounted(density, actions):
    """The integral of a density over each cell and at each whole action, and their shares of the draws."""
    found, counts = np.unique(actions, axis=0, return_counts=True)
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
