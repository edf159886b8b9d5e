"""The forward pass and the policy of an actor network."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from helpers import networks
from helpers.policies import proposed
from pydantic import ValidationError

from ibdata.errors import ConfigError
from ibdata.experiment import Experiment, load
from ibdata.policies import weights_file
from ibdata.policies.network import TANH_EDGE as EDGE
from ibdata.policies.network import Network, squashed
from ibdata.policies.weights_file import Weights

SHAPES = [(1, ()), (2, (8, 5)), (30, (64, 9, 4))]


def outputs(policy, history):
    return policy.weights.outputs(history.reshape(len(history), -1))


@pytest.fixture
def saved(tmp_path, monkeypatch):
    """A function that saves weights in the current folder and makes a policy of them."""
    monkeypatch.chdir(tmp_path)

    def save(**options):
        (tmp_path / "actor.safetensors").write_bytes(networks.weights(**options))
        return Network(file="actor.safetensors")

    return save


def histories(n, frames, seed=0):
    return np.random.default_rng(seed).uniform(0.0, 100.0, (n, frames, 6)).astype(np.float32)


def in_order(history, tensors, tanh_inside=False):
    """The outputs, one term after the other in float32, for all lanes at a time."""
    mean = np.tile(np.array(networks.MEAN, dtype=np.float32), history.shape[1])
    std = np.tile(np.array(networks.STD, dtype=np.float32), history.shape[1])
    x = np.clip((history.reshape(len(history), -1) - mean) / std, np.float32(-10.0), np.float32(10.0))
    names = [name.removesuffix(".weight") for name in tensors if name.endswith(".weight")]
    heads = []
    for name in names:
        weight, bias = tensors[f"{name}.weight"], tensors[f"{name}.bias"]
        y = np.repeat(bias[None], len(x), axis=0)
        for k in range(weight.shape[1]):
            y = y + x[:, k : k + 1] * weight[:, k]
        if name.startswith("layers"):
            x = np.tanh(y.astype(np.float64)).astype(np.float32) if tanh_inside else np.where(y > 0, y, 0.0)
            x = x.astype(np.float32)
        else:
            heads.append(y)
    return np.concatenate(heads, axis=1)


@pytest.mark.parametrize(("frames", "hidden"), SHAPES)
@pytest.mark.parametrize("log_std", [True, False])
def test_sums_are_taken_in_order_in_float32(saved, frames, hidden, log_std):
    policy = saved(frames=frames, hidden=hidden, log_std=log_std)
    history = histories(300, frames)
    expected = in_order(history, networks.tensors(frames, hidden, log_std))
    np.testing.assert_array_equal(outputs(policy, history), expected)


def test_the_action_is_the_tanh_of_the_mean_and_one_next_to_it(saved):
    policy = saved(mean="[0, 0, 0, 0, 0, 0]", std="[1, 1, 1, 1, 1, 1]")
    history = histories(2000, 2) / 10
    expected = np.tanh(outputs(policy, history)[:, :3].astype(np.float64))
    action = proposed(policy, history, np.empty((2000, 0)))
    edge = np.abs(expected) >= EDGE
    assert edge.any()
    np.testing.assert_array_equal(action[edge], np.sign(expected[edge]))
    np.testing.assert_allclose(action, expected, atol=1e-6)


def test_an_action_within_2_to_the_minus_20_of_an_end_is_the_end():
    inside, outside = np.arctanh([1 - 2.0**-19, 1 - 2.0**-20.5])
    assert squashed(inside, True) == pytest.approx(1 - 2.0**-19, abs=1e-9)
    assert (squashed(outside, True), squashed(-outside, True)) == (1.0, -1.0)


def test_a_policy_is_its_weights_not_their_path(saved, tmp_path):
    policy = saved()
    (tmp_path / "actor.safetensors").rename(tmp_path / "other.safetensors")
    other = Network(file="other.safetensors", name="b")
    assert other.form() == policy.form() == {"kind": "network", "sha256": policy.sha256}
    assert policy.file == f"policy-{policy.sha256[:16]}.safetensors"
    assert policy.model_copy(update={"name": "b"}) == other
    assert pickle.loads(pickle.dumps(policy)) == policy


def test_another_file_has_its_own_sha256(saved, tmp_path):
    (tmp_path / "new.safetensors").write_bytes(networks.weights(seed=3))
    old, new = saved(), Network(file="new.safetensors")
    made = Experiment(name="x", setpoints=70, policies=[old])
    assert load(made, {"policies.0.file": "new.safetensors"}).policies == [new] != [old]
    assert old.model_copy(update={"file": "new.safetensors"}) == new
    with pytest.raises(
        ValidationError, match=f"found weights with SHA-256 {new.sha256}, expected {old.sha256}"
    ):
        Network(file="new.safetensors", sha256=old.sha256)


def test_paths_are_relative_to_the_experiment(saved, tmp_path):
    policy = saved()
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "mine.yaml").write_text(
        "name: mine\nsetpoints: 70\npolicies: [{kind: network, file: ../actor.safetensors}]\n"
    )
    assert load(tmp_path / "deep" / "mine.yaml").policies == [policy]


def test_shipped_weights_have_names_but_a_users_file_is_first(saved, tmp_path, monkeypatch):
    folder = tmp_path / "shipped"
    folder.mkdir()
    (folder / "high.safetensors").write_bytes(networks.weights(seed=3))
    monkeypatch.setattr(weights_file, "SHIPPED", folder)
    shipped = Weights(networks.weights(seed=3)).sha256
    assert Network(file="high").sha256 == Network(file="high.safetensors").sha256 == shipped
    with pytest.raises(ValidationError, match="expected one in the current folder; did you mean 'high'"):
        Network(file="hihg")
    saved()
    (tmp_path / "actor.safetensors").rename(tmp_path / "high")
    assert Network(file="high").sha256 == Weights(networks.weights()).sha256


def test_plain_data_of_an_experiment_says_where_its_weights_are(saved):
    made = Experiment(name="x", setpoints=70, policies=[saved()])
    assert load(made) == made
    line = r"no file 'policy-.{16}.safetensors', expected one in the current folder; give the exp"
    with pytest.raises(ConfigError, match=line):
        load(made.plain())
