"""Noise that depends on the steps before: its covariance and its spectrum."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.policies import drawn, played, playing

from ibdata.policies import POLICIES
from ibdata.policies.noise import transform

OrnsteinUhlenbeck, ColouredNoise = POLICIES["ornstein_uhlenbeck"], POLICIES["coloured_noise"]
BASE = {"kind": "constant", "action": [0.5, -0.25, 0.0]}
N = 4000


def test_an_ornstein_uhlenbeck_process_is_its_equation():
    # Φ⁻¹(0.975) = 1.959964; x = 0.2 · 1.959964, then 0.85 x + 0.2 · 0.
    policy = OrnsteinUhlenbeck(base=BASE)
    given = next(given for given, _ in playing(policy, 1, 1))._replace(uniforms=np.full((1, 3), 0.975))
    first = policy.decide(given)
    [back] = drawn(policy, given._replace(uniforms=np.full((1, 3), 0.5), memory=first.memory))
    assert first.memory[0] == pytest.approx([0.3919928] * 3)
    [moved] = drawn(policy, given)
    assert moved == pytest.approx([0.8919928, 0.1419928, 0.3919928])
    assert back == pytest.approx([0.8331939, 0.0831939, 0.3331939])


def test_it_has_the_moments_of_its_equation():
    """Var x[t] = σ² Σ ρ²ᵏ, k < t, and the correlation of neighbours is ρ = 1 - θ, here at t = 20."""
    policy = OrnsteinUhlenbeck(theta=0.25, sigma=0.1)
    x = played(policy, N, 21)
    rho = 0.75
    for t in (1, 4, 20):
        variance = 0.01 * (1.0 - rho ** (2 * t)) / (1.0 - rho**2)
        # Six standard errors of a variance of 12,000 normal numbers are 8 %.
        assert x[:, t - 1].var() == pytest.approx(variance, rel=0.08)
    assert np.corrcoef(x[:, 19].ravel(), x[:, 20].ravel())[0, 1] == pytest.approx(rho, abs=0.03)
    assert np.corrcoef(x[:, 20, 0], x[:, 20, 1])[0, 1] == pytest.approx(0.0, abs=0.1)


def test_the_transform_is_the_inverse_one_of_numpy():
    random, n = np.random.default_rng(0), 64
    c = random.normal(size=n) + 1j * random.normal(size=n)
    angle = 2.0 * np.pi * np.arange(n // 2) / n
    real, imaginary = c.real.copy(), c.imag.copy()
    transform(real, imaginary, np.cos(angle), np.sin(angle))
    np.testing.assert_allclose(real + 1j * imaginary, np.fft.ifft(c) * n, atol=1e-12)


@pytest.mark.parametrize("beta", [0.0, 1.0, 2.0])
def test_the_spectrum_is_a_power_of_the_frequency(beta):
    """log E|X_k|² falls by β log k; 300 episodes and three numbers give each a standard error of 1/30."""
    policy = ColouredNoise(beta=beta, scale=1e-3, period=64)  # so small that nothing is clipped
    x = played(policy, 300, 64) / 1e-3
    power = (np.abs(np.fft.rfft(x, axis=1)) ** 2).mean(axis=(0, 2))
    k = np.arange(1, 32)
    slope = np.polyfit(np.log(k), np.log(power[k]), 1)[0]
    assert slope == pytest.approx(-beta, abs=0.06)
    assert power[0] < 1e-6  # float32
    assert x.var() == pytest.approx(1.0, rel=0.15)


def test_coloured_noise_is_stationary_and_repeats_itself():
    policy = ColouredNoise(scale=1e-3, period=16)
    x = played(policy, N, 32) / 1e-3
    assert (x[:, :16] == x[:, 16:]).all()
    assert x.var(axis=(0, 2))[:16] == pytest.approx(np.ones(16), rel=0.08)
    assert x.mean(axis=(0, 2))[:16] == pytest.approx(np.zeros(16), abs=0.06)
    assert np.corrcoef(x[:, 3, 0], x[:, 3, 1])[0, 1] == pytest.approx(0.0, abs=0.1)


def test_pink_noise_is_added_to_the_base():
    noise, both = (played(ColouredNoise(**base, scale=1e-3, period=8), 5, 8) for base in ({}, {"base": BASE}))
    np.testing.assert_allclose(both - noise, np.full((5, 8, 3), BASE["action"]), atol=1e-6)
