"""Noise that depends on the steps before: its covariance."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.policies import drawn, playing

from ibdata.policies import POLICIES

OrnsteinUhlenbeck = POLICIES["ornstein_uhlenbeck"]
BASE = {"kind": "constant", "action": [0.5, -0.25, 0.0]}


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
