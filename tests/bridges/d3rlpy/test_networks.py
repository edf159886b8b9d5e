"""Networks of Stable-Baselines3, d3rlpy and plain torch act in ibdata as they do in their library."""

from __future__ import annotations

import json
import subprocess
import sys
from itertools import pairwise

import d3rlpy
import numpy as np
import pytest
import torch
from gymnasium import Env, spaces
from gymnasium.wrappers import FlattenObservation, FrameStackObservation
from helpers import ROOT
from helpers.asking import action_of, proposed
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.torch_layers import FlattenExtractor
from stable_baselines3.common.vec_env import DummyVecEnv, VecFrameStack, VecNormalize

import ibdata
from ibdata.errors import UsageError
from ibdata.evaluation.policies import policy_of
from ibdata.policies.base import at_start
from ibdata.policies.network import Network
from ibdata.policies.sampled import Sampled

FRAMES = 3
MEAN, STD = [55.0, 49.0, 50.5, 49.5, 37.5, 166.0], [28.0, 12.0, 30.0, 29.0, 31.0, 139.0]


class Still(Env):
    """An environment in which nothing happens, with the observations of ibdata."""

    observation_space = spaces.Box(-np.inf, np.inf, (6 * FRAMES,), np.float32)
    action_space = spaces.Box(-1.0, 1.0, (3,), np.float32)

    def reset(self, **_):
        return np.zeros(6 * FRAMES, np.float32), {}

    def step(self, action):
        return np.zeros(6 * FRAMES, np.float32), 0.0, False, False, {}


class One(Still):
    observation_space = spaces.Box(-np.inf, np.inf, (6,), np.float32)

    def reset(self, **_):
        return np.zeros(6, np.float32), {}


class Narrow(Still):
    action_space = spaces.Box(-0.5, 0.5, (3,), np.float32)


def observed(n=500):
    rng = np.random.default_rng(0)
    return rng.normal(MEAN, STD, (n, FRAMES, 6)).astype(np.float32)


def scaled(history, mean=MEAN, std=STD, clip=10.0):
    flat = (history - np.array(mean)) / np.array(std)
    return np.clip(flat, -clip, clip).reshape(len(history), -1).astype(np.float32)


def enlarged(module):
    """Make biases and weights large enough for actions of all sizes."""
    torch.manual_seed(1)
    with torch.no_grad():
        for parameter in module.parameters():
            parameter.add_(0.2 / parameter.shape[-1] ** 0.5 * torch.randn_like(parameter))


def of_stable_baselines(algorithm, env=Still, net=None, **options):
    torch.set_num_threads(1)
    env = env() if isinstance(env, type) else env
    model = algorithm("MlpPolicy", env, seed=0, device="cpu", policy_kwargs=dict(net or {}), **options)
    enlarged(model.policy)
    return model


def saved(path, model, **options):
    ibdata.save_network(path, model, history=FRAMES, **options)
    return Network(file=str(path))


SMALL = {"net_arch": [32, 16]}
TANH = {"net_arch": [8], "activation_fn": torch.nn.Tanh}


@pytest.mark.parametrize("algorithm", [SAC, TD3, PPO])
@pytest.mark.parametrize("net", [{}, SMALL, TANH], ids=["default", "small", "tanh"])
def test_stable_baselines_acts_the_same(tmp_path, algorithm, net):
    model, history = of_stable_baselines(algorithm, net=net), observed()
    policy = saved(tmp_path / "actor.safetensors", model, mean=MEAN, std=STD, clip=10.0)
    expected, _ = model.predict(scaled(history), deterministic=True)
    np.testing.assert_allclose(action_of(policy, history), expected, rtol=0.0, atol=1e-5)
    assert expected.std() > 0.05


def test_the_scaling_of_a_vec_normalize_is_taken_over(tmp_path):
    env = VecNormalize(DummyVecEnv([Still]))
    env.obs_rms.mean, env.obs_rms.var = np.tile(MEAN, FRAMES), np.tile(STD, FRAMES) ** 2
    model, history = of_stable_baselines(PPO, env), observed()
    policy = saved(tmp_path / "actor.safetensors", model)
    expected, _ = model.predict(env.normalize_obs(history.reshape(len(history), -1)), deterministic=True)
    np.testing.assert_allclose(action_of(policy, history), expected, rtol=0.0, atol=1e-5)
    own = proposed(policy_of(model, FRAMES), history)
    np.testing.assert_allclose(np.clip(own, -1.0, 1.0), expected, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("algorithm", [SAC, PPO])
def test_draws_have_the_density_of_stable_baselines(tmp_path, algorithm):
    model, history = of_stable_baselines(algorithm, net=SMALL), observed()
    policy = Sampled(base=saved(tmp_path / "actor.safetensors", model, mean=MEAN, std=STD), share=1.0)
    given = at_start(history, policy.needs, np.random.default_rng(1).random((len(history), 4)))
    action = np.clip(np.asarray(policy.decide(given).actions), -1.0, 1.0).astype(np.float32)
    inside = (np.abs(action) < 0.99).all(axis=1)
    seen, done = (torch.as_tensor(x[inside]) for x in (scaled(history, clip=1e9), action))
    with torch.no_grad():
        if algorithm is SAC:
            mean, log_std, _ = model.policy.actor.get_action_dist_params(seen)
            before = torch.atanh(done.double())
            normal = torch.distributions.Normal(mean.double(), log_std.double().exp())
            expected = (normal.log_prob(before) - torch.log(1.0 - done.double() ** 2)).sum(dim=1)
        else:
            expected = model.policy.get_distribution(seen).log_prob(done)
    found = policy.log_density(given.apply(lambda x: x[inside]), action[inside])
    assert inside.sum() > 10
    np.testing.assert_allclose(found, expected.numpy(), rtol=1e-3, atol=1e-3)


def built(config):
    algorithm = config.create(device="cpu:0")
    algorithm.create_impl((6 * FRAMES,), 3)
    enlarged(algorithm.impl.policy)
    return algorithm


@pytest.mark.parametrize("name", ["SAC", "TD3", "TD3PlusBC", "CQL", "CalQL", "IQL", "AWAC", "DDPG", "BC"])
@pytest.mark.parametrize("scaler", [False, True], ids=["raw", "standard"])
def test_d3rlpy_acts_the_same(tmp_path, name, scaler):
    own = {}
    if scaler:
        statistics = {"mean": np.tile(MEAN, FRAMES), "std": np.tile(STD, FRAMES)}
        own = {"observation_scaler": d3rlpy.preprocessing.StandardObservationScaler(**statistics)}
    model, history = built(getattr(d3rlpy.algos, f"{name}Config")(**own)), observed()
    given = {} if scaler else {"mean": MEAN, "std": STD}
    policy = saved(tmp_path / "actor.safetensors", model, **given)
    seen = history.reshape(len(history), -1) if scaler else scaled(history, clip=1e9)
    np.testing.assert_allclose(action_of(policy, history), model.predict(seen), rtol=0.0, atol=1e-5)
    assert policy.weights.has_log_std == (name in ("SAC", "CQL", "CalQL"))


@pytest.mark.parametrize("ends", [[], [torch.nn.Tanh()]], ids=["clipped", "tanh"])
@pytest.mark.parametrize("activation", [torch.nn.ReLU, torch.nn.Tanh])
def test_a_sequential_acts_the_same(tmp_path, ends, activation):
    parts = [torch.nn.Linear(6 * FRAMES, 12), activation(), torch.nn.Linear(12, 3, bias=False), *ends]
    model, history = torch.nn.Sequential(*parts), observed()
    enlarged(model)
    policy = saved(tmp_path / "actor.safetensors", model, mean=MEAN, std=STD, clip=10.0, provenance="here")
    with torch.no_grad():
        expected = model(torch.as_tensor(scaled(history))).numpy().clip(-1.0, 1.0)
    np.testing.assert_allclose(action_of(policy, history), expected, rtol=0.0, atol=1e-5)
    assert policy.weights.metadata.provenance == "here"


LINEAR = torch.nn.Linear(6 * FRAMES, 3)


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (lambda: object(), "found object"),
        (lambda: of_stable_baselines(SAC, use_sde=True), "found use_sde=True"),
        (lambda: of_stable_baselines(SAC, Narrow), "found actions from"),
        (lambda: d3rlpy.algos.SACConfig().create(), "that is not built"),
        (lambda: torch.nn.Sequential(LINEAR, torch.nn.GELU(), torch.nn.Linear(3, 3)), "found Linear, GELU"),
        (lambda: torch.nn.Sequential(LINEAR, torch.nn.Linear(3, 3)), "found Linear, Linear"),
        (lambda: torch.nn.Linear(6, 3), "mean: found weights of shape"),
        (lambda: torch.nn.Linear(6 * FRAMES, 4), "mean: found weights of shape"),
    ],
)
def test_another_model_is_refused(tmp_path, model, message):
    with pytest.raises(ibdata.IbdataError, match="model: ") as error:
        ibdata.save_network(tmp_path / "actor.safetensors", model(), history=FRAMES)
    assert message in str(error.value)
    assert list(tmp_path.iterdir()) == []


def test_a_scaler_of_a_constant_setpoint_is_no_other_action(tmp_path):
    """Its divisor is so small that float32 observations around its mean are far apart once scaled."""
    statistics = {"mean": np.tile(MEAN, FRAMES), "std": np.tile([0.0, *STD[1:]], FRAMES)}
    scaler = d3rlpy.preprocessing.StandardObservationScaler(**statistics, eps=1e-6)
    model = built(d3rlpy.algos.TD3Config(observation_scaler=scaler))
    history = observed()
    history[:, :, 0] = MEAN[0]
    expected = model.predict(history.reshape(len(history), -1))
    found = action_of(saved(tmp_path / "actor.safetensors", model), history)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-5)


def test_behaviour_cloning_keeps_no_untrained_distribution(tmp_path):
    policy = saved(tmp_path / "actor.safetensors", built(d3rlpy.algos.BCConfig(policy_type="stochastic")))
    assert not policy.weights.has_log_std


class Scaled(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.net = torch.nn.Sequential(torch.nn.Linear(6 * FRAMES, 8), torch.nn.ReLU(), torch.nn.Linear(8, 3))

    def forward(self, x):
        return torch.tanh(self.net(x / 10.0))


class Clamped(torch.nn.Sequential):
    """A large network, whose numbers are large too, and which clamps its inputs."""

    def __init__(self):
        sizes = (6 * FRAMES, 256, 256, 256)
        layers = [torch.nn.Linear(n, m) for n, m in pairwise(sizes)]
        with torch.no_grad():
            for layer in layers:
                layer.weight.mul_(3.0)
        hidden = [part for layer in layers for part in (layer, torch.nn.ReLU())]
        super().__init__(*hidden, torch.nn.Linear(256, 3), torch.nn.Tanh())

    def forward(self, x):
        return super().forward(x.clamp(-3.0, 3.0))


class Halved(FlattenExtractor):
    def forward(self, observations):
        return 0.5 * super().forward(observations)


@pytest.mark.parametrize("model", [
    Scaled,
    Clamped,
    lambda: built(d3rlpy.algos.CRRConfig()),
    lambda: of_stable_baselines(TD3, net={"features_extractor_class": Halved}),
    lambda: of_stable_baselines(SAC, net={"features_extractor_class": Halved}),
], ids=["own forward", "clamp", "choice of draws", "extractor of TD3", "extractor of SAC"])  # fmt: skip
def test_a_model_that_does_more_than_its_layers_is_refused(tmp_path, model):
    with pytest.raises(
        UsageError, match=r"^model: found \w+, whose actions are up to [0-9.e-]+ from those of"
    ):
        saved(tmp_path / "actor.safetensors", model())


@pytest.mark.parametrize(("env", "name"), [
    (lambda: VecFrameStack(DummyVecEnv([One]), FRAMES), "VecFrameStack"),
    (lambda: DummyVecEnv([lambda: FlattenObservation(FrameStackObservation(One(), FRAMES))]), "FrameStackOb"),
])  # fmt: skip
def test_a_stack_with_the_oldest_observation_first_is_refused(tmp_path, env, name):
    model = of_stable_baselines(TD3, env())
    with pytest.raises(UsageError, match=f"found {name}.*, which puts the oldest observation first"):
        saved(tmp_path / "actor.safetensors", model)
    with pytest.raises(UsageError, match=f"found {name}.*, which puts the oldest observation first"):
        ibdata.evaluate(model, history=FRAMES, episodes=1, steps=2)


def test_a_saved_network_makes_a_dataset(tmp_path):
    model = of_stable_baselines(SAC, net=SMALL)
    sha256 = ibdata.save_network(tmp_path / "actor.safetensors", model, mean=MEAN, std=STD, history=FRAMES)
    block = {"kind": "sampled", "share": 0.2, "base": {"kind": "network", "file": "actor.safetensors"}}
    (tmp_path / "mine.yaml").write_text(
        json.dumps({"name": "mine", "setpoints": 70, "policies": [block], "steps": 20})
    )
    dataset = ibdata.generate(tmp_path / "mine.yaml", tmp_path / "mine", workers=1)
    assert f"meta/policy-{sha256[:16]}.safetensors" in dataset.manifest_model.entries()
    assert ibdata.validate(dataset.path) == []


def test_the_page_about_networks_prints_what_it_says(tmp_path):
    page = ROOT / "docs" / "networks.md"
    done = subprocess.run(
        [sys.executable, str(ROOT / "scripts/guide"), str(page)], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == "True\nTrue\n"
