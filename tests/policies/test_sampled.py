"""Draws from a network's own distribution, and their density."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from helpers import networks
from helpers.asking import action_of
from pydantic import ValidationError

from ibdata.policies.actions import applied
from ibdata.policies.base import Needs, at_start
from ibdata.policies.gaussian import Gaussian
from ibdata.policies.network import TANH_EDGE as EDGE
from ibdata.policies.network import Network
from ibdata.policies.sampled import ATANH_OF_EDGE as ATANH_EDGE
from ibdata.policies.sampled import Sampled, log_component, rounded_to
from ibdata.policies.tensors import written
from ibdata.testing import check_policy

NORMAL = {"mean": [0.3, -1.2, 2.0], "log_std": [-1.0, 0.2, -0.5]}
EDGY = {"mean": [7.0, 7.4, -12.0], "log_std": [-2.0, -3.0, 0.5]}  # tanh 7.278 = 1 - 2⁻²⁰
NARROW = {"mean": [0.3, -1.2, 9.0], "log_std": [-20.0, -17.0, -16.0]}  # beside the float32 grid
COMPONENTS = [(0.3, -1.0), (-1.2, 0.2), (2.0, -0.5), (7.0, -2.0), (7.27, 1.0), (-12.0, 0.5), (0.0, 2.0)]


@pytest.fixture
def sampled(tmp_path, monkeypatch):
    """A function that makes a policy of a network whose outputs depend little or not on what it sees."""
    monkeypatch.chdir(tmp_path)

    def make(mean, log_std, share=0.3, varying=0.0, texts=None):
        tensors = networks.tensors(frames=1, hidden=(4,))
        for name, values in (("mean", mean), ("log_std", log_std)):
            tensors[f"{name}.bias"] = np.array(values, dtype=np.float32)
            tensors[f"{name}.weight"] *= np.float32(varying)
        data = written(tensors, {**networks.metadata(1), **(texts or {})})
        (tmp_path / "actor.safetensors").write_bytes(data)
        return Sampled(base=Network(file="actor.safetensors"), share=share)

    return make


def drawn(policy, n, seed=0):
    """What a policy is given in n states, and its actions."""
    rng = np.random.default_rng(seed)
    seen = rng.uniform(0.0, 100.0, (n, 1, 6)).astype(np.float32)
    given = at_start(seen, policy.needs, rng.random((n, 4)))
    return given, applied(policy.decide(given).actions)


def density(action, mean, log_std, by_tanh=True):
    action = np.float32(action)
    return log_component(action, *rounded_to(action, by_tanh), mean, log_std, by_tanh)


@pytest.mark.parametrize("share", [0.3, 1.0])
@pytest.mark.parametrize("squash", ["tanh", "clip"])
def test_the_published_checks_pass(sampled, share, squash):
    check_policy(sampled(**NORMAL, share=share, varying=0.3, texts={"squash": squash}))


def test_a_share_of_the_steps_plays_a_whole_draw_and_the_others_the_mean(sampled):
    policy = sampled(**NORMAL, share=0.25)
    given, action = drawn(policy, 4000)
    mean = action_of(policy.base, given.observations)
    same = action == mean
    assert (same.all(axis=1) == (given.uniforms[:, 0] >= 0.25)).all()
    assert not (same.any(axis=1) & ~same.all(axis=1)).any()


def test_draws_have_the_distribution_of_the_network(sampled):
    policy = sampled(**NORMAL, share=1.0)
    _, action = drawn(policy, 40_000)
    before = np.arctanh(action.astype(np.float64))
    error = np.exp(NORMAL["log_std"]) / math.sqrt(40_000)
    assert (np.abs(before.mean(axis=0) - NORMAL["mean"]) < 4.0 * error).all()
    np.testing.assert_allclose(before.std(axis=0), np.exp(NORMAL["log_std"]), rtol=0.02)


@pytest.mark.parametrize(
    ("way", "given", "expected"),
    [("clamp", [-9.0, -1.0, 2.5], [-5.0, -1.0, 2.0]), ("tanh", [-30.0, 0.0, 0.5493], [-5.0, -1.5, 0.25])],
)
def test_log_deviations_are_bounded_as_the_file_says(sampled, way, given, expected):
    texts = {"log_std": way, "log_std_low": "-5", "log_std_high": "2", "squash": "clip"}
    policy = sampled([0.0, 0.0, 0.0], given, share=1.0, texts=texts)
    seen = at_start(np.zeros((1, 1, 6), np.float32), Needs(), np.array([[0.5, 0.8, 0.8, 0.8]]))
    z = 0.8416212335729143  # Φ⁻¹(0.8)
    np.testing.assert_allclose(policy.decide(seen).actions[0], z * np.exp(expected), rtol=1e-4)


def test_the_edge_is_that_of_the_action():
    assert pytest.approx(float(mpmath.atanh(mpmath.mpf(EDGE))), rel=1e-15) == ATANH_EDGE


@pytest.mark.parametrize(("mean", "log_std"), COMPONENTS)
@pytest.mark.parametrize("by_tanh", [True, False])
def test_the_density_of_a_number_integrates_to_1(mean, log_std, by_tanh):
    """Over the number before the squash, where the density is smooth, and the masses at ±1."""
    edge = ATANH_EDGE if by_tanh else 1.0
    middle, reach = (mean, 9.0 * math.exp(log_std)) if abs(mean) < edge else (math.copysign(edge, mean), 20.0)
    x = np.linspace(max(-edge, middle - reach), min(edge, middle + reach), 40_001)[1:-1]
    action = (np.tanh(x) if by_tanh else x).astype(np.float32)
    slope = 1.0 - action.astype(np.float64) ** 2 if by_tanh else 1.0
    inside = (np.exp([density(a, mean, log_std, by_tanh) for a in action]) * slope).sum() * (x[1] - x[0])
    masses = sum(math.exp(density(a, mean, log_std, by_tanh)) for a in (-1.0, 1.0))
    assert inside + masses == pytest.approx(1.0, abs=2e-4)


@pytest.mark.parametrize("log_std", [-20.0, -17.0, -15.0, -13.0])
@pytest.mark.parametrize("mean", [0.5493061443340549, -0.3, 1.2, 7.27])
def test_beside_a_narrow_distribution_the_masses_of_all_float32_actions_add_up_to_1(mean, log_std):
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
        s = mp.exp(log_std)
        expected = mp.log(mp.npdf(mp.atanh(a), mean, s) / (1 - a * a))
        assert density(action, mean, log_std) == pytest.approx(float(expected), rel=1e-12, abs=1e-12)


def test_a_clipped_draw_has_the_density_of_gaussian_noise(tmp_path):
    tensors = networks.tensors(frames=1, hidden=(4,))
    tensors["mean.weight"] *= np.float32(0.0)
    tensors["mean.bias"] = np.array([0.25, -0.5, 0.75], dtype=np.float32)
    del tensors["log_std.weight"]
    tensors["log_std.bias"] = np.full(3, -0.5, dtype=np.float32)
    path = tmp_path / "ppo.safetensors"
    path.write_bytes(written(tensors, networks.metadata(1, squash="clip")))
    base = Network(file=str(path))
    policy, noise = Sampled(base=base, share=1.0), Gaussian(base=base, scale=math.exp(-0.5))
    given, action = drawn(policy, 500)
    assert (np.abs(action) == 1.0).any()
    np.testing.assert_allclose(policy.log_density(given, action), noise.log_density(given, action), rtol=1e-9)


def test_the_mean_action_has_a_mass_of_its_own(sampled):
    policy = sampled(**NORMAL, share=0.3)
    given, _ = drawn(policy, 1)
    mean = action_of(policy.base, given.observations)
    assert policy.log_density(given, mean)[0] == pytest.approx(math.log(0.7), rel=1e-9)
    other = mean + np.float32([0.0, 0.0, 0.01])
    alone = Sampled(base=policy.base, share=1.0)
    expected = math.log(0.3) + alone.log_density(given, other)[0]
    assert policy.log_density(given, other)[0] == pytest.approx(expected, rel=1e-12)


def refuse_another_mean_than_1(first, second):
    """Draw from the first policy and weigh the draws for the second one."""
    given, action = drawn(first, 100_000)
    weight = np.exp(second.log_density(given, action) - first.log_density(given, action))
    error = weight.std() / math.sqrt(len(weight))
    assert abs(weight.mean() - 1.0) <= 4.0 * error + 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("outputs", [NORMAL, EDGY, NARROW])
@pytest.mark.parametrize("shares", [(0.2, 0.8), (0.9, 0.1)])
def test_importance_weights_between_shares_have_the_mean_1(sampled, outputs, shares):
    first, second = (sampled(**outputs, share=share, varying=0.3) for share in shares)
    refuse_another_mean_than_1(first, second)


@pytest.mark.slow
@pytest.mark.parametrize("outputs", [NORMAL, EDGY, NARROW])
def test_importance_weights_between_networks_have_the_mean_1(sampled, outputs):
    wide = sampled(**outputs, share=1.0)
    std = np.exp(outputs["log_std"])
    moved = {"mean": outputs["mean"] + 0.3 * std, "log_std": np.array(outputs["log_std"]) - 0.3}
    refuse_another_mean_than_1(wide, sampled(**moved, share=1.0))


@pytest.mark.parametrize(
    ("block", "message"),
    [
        ({"share": 0.0}, "greater than 0"),
        ({"share": 1.1}, "less than or equal to 1"),
        ({"base": {"kind": "optimized"}}, "network"),
        ({"base": {"kind": "network", "file": "td3.safetensors"}}, "found weights without log_std"),
        ({"base": {"kind": "network", "file": "actor.safetensors", "name": "x"}}, "found a name in the base"),
    ],
)
def test_a_wrong_block_is_refused(sampled, tmp_path, block, message):
    policy = sampled(**NORMAL)
    (tmp_path / "td3.safetensors").write_bytes(networks.weights(log_std=False))
    with pytest.raises(ValidationError, match=message):
        policy.model_copy(update=block)
