"""Noise that depends on the steps before: its covariance and its spectrum."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.policies import drawn, played, playing

from ibdata.policies import POLICIES
from ibdata.policies.noise import transform

OrnsteinUhlenbeck, ColouredNoise = POLICIES["ornstein_uhlenbeck"], POLICIES["coloured_noise"]
BASE = {"kind": "constant", "action": [0.5, -0.25, 0.0]}


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
