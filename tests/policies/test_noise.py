"""Noise that depends on the steps before: its covariance."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.policies import drawn, played, playing

from ibdata.policies import POLICIES

OrnsteinUhlenbeck = POLICIES["ornstein_uhlenbeck"]
BASE = {"kind": "constant", "action": [0.5, -0.25, 0.0]}
N = 4000


def test_an_ornstein_uhlenbeck_process_is_its_equation():
    # Φ⁻¹(0.975) = 1.959964; x = 0.2 · 1.959964, then 0.85 x + 0.2 · 0.
    policy = OrnsteinUhlenbeck(base=BASE)
    given = next(given for given, _ in playing(policy, 1, 1))._replace(draws=np.full((1, 3), 0.975))
    first = policy.decide(given)
    [back] = drawn(policy, given._replace(draws=np.full((1, 3), 0.5), memory=first.memory))
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
