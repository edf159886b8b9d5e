"""Policies that wrap others, noise and signals by their equations. `test_recount` counts draws."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from helpers.policies import BASE, drawn, playing, proposed

from ibdata._numerics.exact import log_cdf
from ibdata.policies import POLICIES
from ibdata.policies.distributions import applied
from ibdata.policies.signals import TAPS, sequence, waves

EpsilonGreedy, Gaussian, Safe = (POLICIES[kind] for kind in ("epsilon_greedy", "gaussian", "safe"))
NUDGE = {"kind": "constant", "action": [0.5, -0.25, 0.0]}
OWN = np.array([0.5, -1.0, 0.1], dtype=np.float32)


def seen(n, frames=1):
    """Histories with the velocity below the range of the safe policy, and the gain inside."""
    history = np.full((n, frames, 6), 30.0, dtype=np.float32)
    history[:, :, 1:3] = 20.0, 50.0
    return history


def test_the_first_draw_decides_and_the_others_are_the_action():
    # 0.2 is not below 0.2. 2 · 0.75 - 1 = ½, 2 · 0.25 - 1 = -½, 2 · 0.875 - 1 = ¾.
    policy = EpsilonGreedy(base=BASE, epsilon=0.2)
    u = np.array([[0.2, 0.75, 0.25, 0.875], [0.1999, 0.75, 0.25, 0.875]])
    assert proposed(policy, seen(2), u).tolist() == [OWN.astype(np.float64).tolist(), [0.5, -0.5, 0.75]]


def test_the_base_has_the_first_draws_and_the_history():
    policy = EpsilonGreedy(base={"kind": "safe"}, epsilon=0.5)
    u = np.random.default_rng(5).random((50, policy.needs.draws))
    u[:, 5] = 0.5
    expected = applied(proposed(Safe(), seen(50), u[:, :5].copy()))
    np.testing.assert_array_equal(proposed(policy, seen(50), u), expected)
    for wrapper, options in ((EpsilonGreedy, {"epsilon": 0.5}), (Gaussian, {"scale": 0.5})):
        assert wrapper(base={"kind": "optimized"}, **options).needs.history == 6


@pytest.mark.parametrize("z", [-300.0, -38.0, -8.0, -3.0001, -2.9999, -1.0, -1e-9, 0.0, 0.5, 2.9, 3.1, 9.0])
def test_log_cdf_is_the_logarithm_of_the_normal_one(z):
    with mpmath.workprec(3000):
        exact = float(mpmath.log(mpmath.ncdf(z)))
    assert float(log_cdf(z)) == pytest.approx(exact, rel=1e-12, abs=2e-16)


def test_an_ornstein_uhlenbeck_process_is_its_equation():
    # Φ⁻¹(0.975) = 1.959964; x = 0.2 · 1.959964, then 0.85 x + 0.2 · 0.
    policy = POLICIES["ornstein_uhlenbeck"](base=NUDGE)
    given = next(given for given, _ in playing(policy, 1, 1))._replace(draws=np.full((1, 3), 0.975))
    first = policy.decide(given)
    [back] = drawn(policy, given._replace(draws=np.full((1, 3), 0.5), memory=first.memory))
    assert first.memory[0] == pytest.approx([0.3919928] * 3)
    [moved] = drawn(policy, given)
    assert moved == pytest.approx([0.8919928, 0.1419928, 0.3919928])
    assert back == pytest.approx([0.8331939, 0.0831939, 0.3331939])


@pytest.mark.parametrize("order", TAPS)
def test_the_sequence_has_the_longest_period(order):
    """Golomb 1967: one 1 more than -1, and an autocorrelation of -1 at every lag."""
    signs = sequence(order)
    n = 2**order - 1
    assert len(signs) == n
    assert signs.sum() == 1.0
    spectrum = np.abs(np.fft.fft(signs)) ** 2
    np.testing.assert_allclose(np.fft.ifft(spectrum).real[1:], -np.ones(n - 1), atol=1e-9)


def test_a_multisine_has_equal_power_in_its_frequencies():
    signals = waves(4, 60)
    for j in range(3):
        power = np.abs(np.fft.rfft(signals[:, j])) ** 2
        own = np.array([3 * i + j + 1 for i in range(4)])
        np.testing.assert_allclose(power[own] / power[own[0]], np.ones(4), atol=1e-9)
        assert np.delete(power, own).max() < 1e-20 * power[own[0]] + 1e-20
