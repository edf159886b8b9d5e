"""Draws from a network's own distribution, and their density. `test_recount` counts them."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from helpers.networks import actor
from helpers.policies import distribution

from ibdata.policies.base import Needs, at_start
from ibdata.policies.distributions import applied
from ibdata.policies.network import Network, Sampled, log_component, rounded_to

COMPONENTS = [(0.3, -1.0), (-1.2, 0.2), (7.0, -2.0), (7.27, 1.0), (-12.0, 0.5)]


@pytest.fixture
def sampled(tmp_path):
    """A function that makes a policy of a network whose outputs depend little or not on what it sees."""

    def make(share=0.3, varying=0.0, **outputs):
        path = tmp_path / "actor.safetensors"
        path.write_bytes(actor(varying=varying, **outputs))
        return Sampled(base=Network(file=str(path)), share=share)

    return make


def density(action, mean, log_std, by_tanh=True):
    action = np.float32(action)
    return log_component(action, *rounded_to(action, by_tanh), mean, log_std, by_tanh)


def test_the_mean_has_a_mass_only_where_it_may_be_played(sampled):
    seen = at_start(np.zeros((1, 1, 6), np.float32), Needs(), np.full((1, 4), 0.9))
    outputs = {"mean": [0.25] * 3, "log_std": [0.0] * 3}
    sometimes, always = (distribution(sampled(share, **outputs), seen) for share in (0.3, 1.0))
    mean = applied(sometimes.sample(seen.draws))
    assert sometimes.atoms(mean).all()
    assert not always.atoms(mean).any()


def test_a_narrow_draw_may_be_the_mean_action(sampled):
    """As docs/networks.md says: log(1 - share + share P), with the mass P of the numbers rounded to it."""
    mean, log_std = [0.5493, -0.3, 1.2], -16.0
    seen = at_start(np.zeros((1, 1, 6), np.float32), Needs(), np.full((1, 4), 0.9))
    found = distribution(sampled(0.3, mean=mean, log_std=[log_std] * 3), seen)
    action = applied(found.sample(seen.draws))  # 0.9 is above the share: the mean
    masses = []
    for a, m in zip(action[0], np.float32(mean), strict=True):
        low, high = rounded_to(a, True)
        masses.append((high - low) * math.exp(log_component(a, low, high, m, log_std, True)))
    assert 1e-6 < np.prod(masses) < 0.9
    assert found.log_density(action) == pytest.approx([math.log(0.7 + 0.3 * np.prod(masses))], rel=1e-9)


@pytest.mark.parametrize(
    ("way", "given", "expected"),
    [("clamp", [-9.0, -1.0, 2.5], [-5.0, -1.0, 2.0]), ("tanh", [-30.0, 0.0, 0.5493], [-5.0, -1.5, 0.25])],
)
def test_log_deviations_are_bounded_as_the_file_says(sampled, way, given, expected):
    texts = {"log_std_low": "-5", "log_std_high": "2", "squash": "clip"}
    policy = sampled(mean=[0.0] * 3, log_std=given, share=1.0, bounded_by=way, **texts)
    seen = at_start(np.zeros((1, 1, 6), np.float32), Needs(), np.array([[0.5, 0.8, 0.8, 0.8]]))
    z = 0.8416212335729143  # Φ⁻¹(0.8)
    np.testing.assert_allclose(
        distribution(policy, seen).sample(seen.draws)[0], z * np.exp(expected), rtol=1e-4
    )


@pytest.mark.parametrize("log_std", [-20.0, -15.0])
@pytest.mark.parametrize("mean", [0.5493061443340549, -0.3, 7.27])
def test_masses_of_float32_actions_add_up_to_1_if_it_is_narrow(mean, log_std):
    """0.5493 is atanh ½, where the spacing of float32 doubles."""
    action, total = np.float32(math.tanh(mean)), 0.0
    for towards in (-2.0, 2.0):
        a = action if towards < 0 else np.nextafter(action, np.float32(towards))
        for _ in range(3000):
            low, high = rounded_to(a, True)
            total += max(0.0, high - low) * math.exp(density(a, mean, log_std)) if abs(a) < 1.0 else 0.0
            a = np.nextafter(a, np.float32(towards))
            if abs(a) >= 1.0:
                break
    total += math.exp(density(1.0, mean, log_std))
    assert total == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(("mean", "log_std"), COMPONENTS)
def test_the_density_agrees_with_the_formula_in_many_digits(mean, log_std):
    mp = mpmath.mp.clone()
    mp.dps = 40
    for action in (-0.999, -0.5, 0.0, 1e-6, 0.3, 0.9):
        a = mp.mpf(float(np.float32(action)))
        expected = mp.log(mp.npdf(mp.atanh(a), mean, mp.exp(log_std)) / (1 - a * a))
        assert density(action, mean, log_std) == pytest.approx(float(expected), rel=1e-12, abs=1e-12)
