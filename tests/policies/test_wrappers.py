"""Policies that wrap others: which actions come from the base, and how often."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from helpers.asking import log_density_of, proposed

from ibdata.policies import POLICIES
from ibdata.policies.gaussian import LOG_SQRT_2PI, log_cdf
from ibdata.policies.random import LOG_EDGE_TO_INSIDE as LOG_EDGE
from ibdata.policies.random import LOG_EIGHTH as LOG_DENSITY

EpsilonGreedy, Gaussian, Safe = (POLICIES[kind] for kind in ("epsilon_greedy", "gaussian", "safe"))
BASE = {"kind": "constant", "action": [0.5, -1.0, 0.1]}
OWN = np.array([0.5, -1.0, 0.1], dtype=np.float32)
N = 100_000
# Five standard errors: a false alarm has a chance of 6e-7, and is excluded by the fixed draws. With N draws
# a share that is wrong by 0.016 (ten standard errors of ½) is found with a chance of 1 - 3e-7.
SIGMAS = 5.0


def lanes(n, policy=None):
    """Histories in which velocity and gain are in all regions of the safe policy."""
    frames = policy.needs.history if policy else 1
    history = np.random.default_rng(3).uniform(0.0, 100.0, (1, frames, 6)).astype(np.float32)
    history[:, :, 1:3] = 20.0, 50.0
    return np.repeat(history, n, axis=0)


def played(policy, n=N):
    history = lanes(n, policy)
    u = np.random.default_rng(4).random((n, policy.needs.step_draws))
    action = np.clip(np.asarray(proposed(policy, history, u)), -1.0, 1.0).astype(np.float32)
    return history, action


def share(events):
    """A share of events, and its standard error times five."""
    p = float(np.mean(events))
    return p, SIGMAS * np.sqrt(max(p * (1.0 - p), 1.0 / len(events)) / len(events))


def log_prob(policy, action):
    return float(log_density_of(policy, lanes(1, policy), np.array([action], dtype=np.float32))[0])


def test_the_first_draw_decides_and_the_others_are_the_action():
    # 0.2 is not below 0.2. 2 · 0.75 - 1 = ½, 2 · 0.25 - 1 = -½, 2 · 1 - 1 = 1.
    policy = EpsilonGreedy(base=BASE, epsilon=0.2)
    u = np.array([[0.2, 0.75, 0.25, 0.875], [0.1999, 0.75, 0.25, 0.875]])
    assert policy.needs.step_draws == 4
    np.testing.assert_array_equal(proposed(policy, lanes(2), u), [OWN.astype(np.float64), [0.5, -0.5, 0.75]])


def test_the_base_has_the_first_draws_and_the_history():
    policy = EpsilonGreedy(base={"kind": "safe"}, epsilon=0.5)
    u = np.random.default_rng(5).random((50, policy.needs.step_draws))
    u[:, 5] = 0.5
    expected = np.clip(np.asarray(proposed(Safe(), lanes(50), u[:, :5].copy())), -1, 1).astype(np.float32)
    np.testing.assert_array_equal(proposed(policy, lanes(50), u), expected)
    assert EpsilonGreedy(base={"kind": "optimized"}, epsilon=0.5).needs.history == 6
    assert Gaussian(base={"kind": "optimized"}, scale=0.5).needs.history == 6


def test_the_base_acts_as_it_would_alone_clipped_and_rounded():
    policy = EpsilonGreedy(base={"kind": "bad"}, epsilon=0.0)
    np.testing.assert_array_equal(proposed(policy, lanes(3), np.full((3, 4), 0.5))[0, :2], [1.0, 1.0])


def test_the_noise_is_the_scale_times_a_normal():
    # Φ⁻¹(½) = 0; Φ⁻¹(0.975) = 1.959964: 0.5 + 0.1 · 1.959964
    policy = Gaussian(base=BASE, scale=0.1)
    action = np.asarray(proposed(policy, lanes(1), np.array([[0.975, 0.5, 0.5]])))[0]
    assert action == pytest.approx([0.6959964, -1.0, np.float64(OWN[2])], abs=1e-7)


@pytest.mark.parametrize("epsilon", [0.2, 0.6])
def test_the_whole_action_is_the_bases_as_often_as_the_density_says(epsilon):
    policy = EpsilonGreedy(base=BASE, epsilon=epsilon)
    _, action = played(policy)
    same = action == OWN
    p, error = share(same.all(axis=1))
    assert p == pytest.approx(np.exp(log_prob(policy, OWN)), abs=error)
    # All or nothing: two numbers alone are the base's with a chance below 1e-7 each.
    assert (same.any(axis=1) == same.all(axis=1)).all()


@pytest.mark.parametrize("j", range(3))
def test_the_noise_is_clipped_as_often_as_the_density_says(j):
    """The base's numbers are 0.5, -1 and 0.1."""
    policy = Gaussian(base=BASE, scale=0.7)
    _, action = played(policy)
    for edge in (-1.0, 1.0):
        at = OWN.copy()
        at[j] = edge
        others = sum(log_prob_of_one(policy, k) for k in range(3) if k != j)
        p, error = share(action[:, j] == edge)
        assert p == pytest.approx(np.exp(log_prob(policy, at) - others), abs=error)


def log_prob_of_one(policy, k):
    """log density of the base's own number k: the normal's height, or the mass of half of it at -1."""
    return float(log_cdf(2.0**-25 / 0.7)) if abs(OWN[k]) == 1 else -np.log(policy.scale) - LOG_SQRT_2PI


def test_a_random_base_makes_a_mixture():
    """log(½ e^a + ½ e^b), a the safe policy's density and b the uniform's."""
    policy = EpsilonGreedy(base={"kind": "safe"}, epsilon=0.25)
    for action in ([0.5, 0.0, 0.0], [1.0, 0.3, 0.3], [-1.0, 0.1, 0.9]):
        safe = float(log_density_of(Safe(), lanes(1), np.array([action], dtype=np.float32))[0])
        uniform = LOG_DENSITY + LOG_EDGE * (abs(action[0]) == 1.0)
        expected = np.log(0.75 * np.exp(safe) + 0.25 * np.exp(uniform))
        assert log_prob(policy, action) == pytest.approx(expected, abs=1e-14)
    _, action = played(policy)
    p, error = share(action[:, 0] == 1.0)
    assert p == pytest.approx(np.exp(log_prob(policy, [1.0, 0.0, 0.0]) + np.log(4.0)), abs=error)


def test_the_density_elsewhere_is_that_of_the_random_action():
    policy = EpsilonGreedy(base=BASE, epsilon=0.2)
    assert log_prob(policy, OWN) == pytest.approx(np.log(0.8), abs=1e-15)
    assert log_prob(policy, [0.5, -1.0, 0.2]) == pytest.approx(np.log(0.2 / 8) + LOG_EDGE, abs=1e-14)
    assert log_prob(policy, [0.4, 0.3, 0.2]) == pytest.approx(np.log(0.2 / 8), abs=1e-14)


def test_nothing_is_certain_never_and_always():
    never, always = (EpsilonGreedy(base=BASE, epsilon=epsilon) for epsilon in (0.0, 1.0))
    assert (log_prob(never, OWN), log_prob(never, [0.4, 0.3, 0.2])) == (0.0, -np.inf)
    # A base that never acts has no mass.
    assert log_prob(always, [0.5, -0.5, 0.1]) == pytest.approx(LOG_DENSITY, abs=1e-15)
    assert log_prob(always, OWN) == pytest.approx(LOG_DENSITY + LOG_EDGE, abs=1e-15)


@pytest.mark.parametrize("z", [-300.0, -38.0, -8.0, -3.0001, -2.9999, -1.0, -1e-9, 0.0, 0.5, 2.9, 3.1, 9.0])
def test_log_cdf_is_the_logarithm_of_the_normal_distribution_function(z):
    with mpmath.workprec(3000):
        exact = float(mpmath.log(mpmath.ncdf(z)))
    assert float(log_cdf(z)) == pytest.approx(exact, rel=1e-12, abs=2e-16)


def test_the_constants_are_their_formulas_rounded_to_a_double():
    with mpmath.workprec(200):
        assert float(mpmath.log(mpmath.sqrt(2 * mpmath.pi))) == LOG_SQRT_2PI


def test_a_narrow_noise_has_finite_densities_too():
    policy = Gaussian(base=BASE, scale=1e-9)
    history, action = played(policy, 1000)
    assert np.isfinite(log_density_of(policy, history, action)).all()


@pytest.mark.parametrize("base", [{"kind": "random"}, {"kind": "safe"}])
def test_a_base_that_is_random_itself_has_no_noise(base):
    with pytest.raises(ValueError, match="expected tags"):
        Gaussian(base=base, scale=0.1)


def test_a_base_has_no_name_of_its_own():
    with pytest.raises(ValueError, match="expected the name beside the outer kind"):
        Gaussian(base={**BASE, "name": "still"}, scale=0.1)


def test_a_base_without_a_density_leaves_none(monkeypatch):
    monkeypatch.setattr(Safe, "log_density", lambda self, given, action: np.full(len(action), np.nan))
    assert np.isnan(log_prob(EpsilonGreedy(base={"kind": "safe"}, epsilon=0.5), [0.0, 0.0, 0.0]))
