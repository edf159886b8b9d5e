"""Networks of Stable-Baselines3, d3rlpy and plain torch act in ibdata as they do in their library."""

import os
import subprocess
import sys

import d3rlpy
import numpy as np
import pytest
import torch
from d3rlpy.preprocessing import StandardObservationScaler
from gymnasium import Env, spaces
from gymnasium.wrappers import FlattenObservation, FrameStackObservation
from helpers import ROOT
from helpers.pages import check_guide
from helpers.policies import action_of, proposed, ready
from helpers.refusals import refused
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.vec_env import DummyVecEnv, VecFrameStack, VecNormalize

import ibdata
from ibdata.evaluation.policies import as_policy
from ibdata.policies.base import at_start
from ibdata.policies.checked import ask
from ibdata.policies.distributions import applied
from ibdata.policies.network import Network, Sampled

FRAMES = 3
MEAN, STD = [55.0, 49.0, 50.5, 49.5, 37.5, 166.0], [28.0, 12.0, 30.0, 29.0, 31.0, 139.0]
SCALING = {"mean": MEAN, "std": STD}
SMALL = {"net_arch": [32, 16]}


class Still(Env):
    """An environment in which nothing happens, with the observations of ibdata."""

    def __init__(self, frames=FRAMES, bound=1.0):
        self.observation_space = spaces.Box(-np.inf, np.inf, (6 * frames,), np.float32)
        self.action_space = spaces.Box(-bound, bound, (3,), np.float32)

    def reset(self, **_):
        return np.zeros(self.observation_space.shape, np.float32), {}


@pytest.fixture
def file(tmp_path):
    return tmp_path / "actor.safetensors"


@pytest.fixture(scope="module")
def history():
    torch.set_num_threads(1)
    return np.random.default_rng(0).normal(MEAN, STD, (500, FRAMES, 6)).astype(np.float32)


def scaled(history, clip=1e9):
    standard = (history - np.array(MEAN)) / np.array(STD)
    return np.clip(standard, -clip, clip).reshape(len(history), -1).astype(np.float32)


def enlarged(module):
    """Make biases and weights large enough for actions of all sizes."""
    torch.manual_seed(1)
    with torch.no_grad():
        for parameter in module.parameters():
            parameter.add_(0.2 / parameter.shape[-1] ** 0.5 * torch.randn_like(parameter))


def of_sb3(algorithm, env=None, net=None, **options):
    model = algorithm(
        "MlpPolicy", env or Still(), seed=0, device="cpu", policy_kwargs=dict(net or {}), **options
    )
    enlarged(model.policy)
    return model


def of_d3rlpy(name, **options):
    algorithm = getattr(d3rlpy.algos, f"{name}Config")(**options).create(device="cpu:0")
    algorithm.create_impl((6 * FRAMES,), 3)
    enlarged(algorithm.impl.policy)
    return algorithm


def saved(file, model, **options):
    ibdata.save_network(file, model, history=FRAMES, **options)
    return Network(file=str(file))


def check_same(policy, history, expected):
    np.testing.assert_allclose(action_of(policy, history), expected, rtol=0.0, atol=1e-5)


@pytest.mark.parametrize("algorithm", [SAC, TD3, PPO])
@pytest.mark.parametrize("net", [{}, {"net_arch": [8], "activation_fn": torch.nn.Tanh}], ids=["own", "tanh"])
def test_stable_baselines_acts_the_same(file, history, algorithm, net):
    model = of_sb3(algorithm, net=net)
    expected, _ = model.predict(scaled(history, clip=10.0), deterministic=True)
    check_same(saved(file, model, **SCALING, clip=10.0), history, expected)
    assert expected.std() > 0.05


def test_the_scaling_of_a_vec_normalize_is_taken_over(file, history):
    env = VecNormalize(DummyVecEnv([Still]))
    env.obs_rms.mean, env.obs_rms.var = np.tile(MEAN, FRAMES), np.tile(STD, FRAMES) ** 2
    model = of_sb3(PPO, env)
    expected, _ = model.predict(env.normalize_obs(history.reshape(len(history), -1)), deterministic=True)
    check_same(saved(file, model), history, expected)
    own = proposed(ready(as_policy(model, FRAMES)), history)
    np.testing.assert_allclose(np.clip(own, -1.0, 1.0), expected, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("algorithm", [SAC, PPO])
def test_draws_have_the_density_of_stable_baselines(file, history, algorithm):
    model = of_sb3(algorithm, net=SMALL)
    policy = Sampled(base=saved(file, model, **SCALING), share=1.0)
    given = at_start(history, policy.needs, np.random.default_rng(1).random((len(history), 4)))
    distribution, _ = ask(policy, given)
    action = applied(distribution.sample(given.draws))
    inside = (np.abs(action) < 0.99).all(axis=1)
    seen, done = (torch.as_tensor(x[inside]) for x in (scaled(history), action))
    with torch.no_grad():
        if algorithm is SAC:
            mean, log_std, _ = model.policy.actor.get_action_dist_params(seen)
            before = torch.atanh(done.double())
            normal = torch.distributions.Normal(mean.double(), log_std.double().exp())
            expected = (normal.log_prob(before) - torch.log(1.0 - done.double() ** 2)).sum(dim=1)
        else:
            expected = model.policy.get_distribution(seen).log_prob(done)
    found = distribution.log_density(action)[inside]
    assert inside.sum() > 10
    np.testing.assert_allclose(found, expected.numpy(), rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("name", ["SAC", "TD3", "TD3PlusBC", "CQL", "CalQL", "IQL", "AWAC", "DDPG", "BC"])
def test_d3rlpy_acts_the_same(file, history, name):
    model = of_d3rlpy(name)
    policy = saved(file, model, **SCALING)
    check_same(policy, history, model.predict(scaled(history)))
    assert policy.weights.has_log_std == (name in ("SAC", "CQL", "CalQL"))


@pytest.mark.parametrize("constant", [False, True])
def test_the_scaler_of_d3rlpy_is_taken_over(file, history, constant):
    """The divisor of a constant is so small that float32 observations around its mean are far apart."""
    seen, std = history.copy(), np.array(STD)
    if constant:
        seen[:, :, 0], std[0] = MEAN[0], 0.0
    scaler = StandardObservationScaler(mean=np.tile(MEAN, FRAMES), std=np.tile(std, FRAMES), eps=1e-6)
    model = of_d3rlpy("TD3", observation_scaler=scaler)
    check_same(saved(file, model), seen, model.predict(seen.reshape(len(seen), -1)))


@pytest.mark.parametrize(
    ("activation", "ends"), [(torch.nn.ReLU, []), (torch.nn.Tanh, [torch.nn.Tanh()])], ids=["clipped", "tanh"]
)
def test_a_sequential_acts_the_same(file, history, activation, ends):
    parts = [torch.nn.Linear(6 * FRAMES, 12), activation(), torch.nn.Linear(12, 3, bias=False), *ends]
    model = torch.nn.Sequential(*parts)
    enlarged(model)
    policy = saved(file, model, **SCALING, clip=10.0, provenance="here")
    with torch.no_grad():
        expected = model(torch.as_tensor(scaled(history, clip=10.0))).numpy().clip(-1.0, 1.0)
    check_same(policy, history, expected)
    assert policy.weights.metadata.provenance == "here"


LINEAR = torch.nn.Linear(6 * FRAMES, 3)


REFUSED = {
    "an object": (object, "found object"),
    "state-dependent noise": (lambda: of_sb3(SAC, use_sde=True), "found use_sde=True"),
    "narrow actions": (lambda: of_sb3(SAC, Still(bound=0.5)), "found actions from"),
    "not built": (lambda: d3rlpy.algos.SACConfig().create(), ".*that is not built"),
    "an activation": (lambda: torch.nn.Sequential(LINEAR, torch.nn.GELU()), "found Linear, GELU"),
    "many outputs": (lambda: torch.nn.Linear(6 * FRAMES, 4), "mean: found weights of shape"),
    "a choice of draws": (
        lambda: of_d3rlpy("CRR"),
        r"found \w+, whose actions are up to [0-9.e-]+ from those",
    ),
}


@pytest.mark.parametrize(("model", "message"), REFUSED.values(), ids=REFUSED)
def test_a_model_that_does_more_than_its_layers_is_refused(file, model, message):
    with pytest.raises(ibdata.IbdataError, match=f"model: {message}"):
        saved(file, model())
    assert list(file.parent.iterdir()) == []


@pytest.mark.parametrize(
    ("env", "name"),
    [
        (VecFrameStack(DummyVecEnv([lambda: Still(1)]), FRAMES), "VecFrameStack"),
        (DummyVecEnv([lambda: FlattenObservation(FrameStackObservation(Still(1), FRAMES))]), "FrameStackOb"),
    ],
    ids=["of sb3", "of gymnasium"],
)
def test_a_stack_with_the_oldest_observation_first_is_refused(file, env, name):
    model, message = of_sb3(TD3, env), f"found {name}.*, which puts the oldest observation first"
    refused(message, saved, file, model, error=ibdata.IbdataError)
    refused(message, ibdata.evaluate, model, error=ibdata.IbdataError, history=FRAMES, episodes=1, steps=2)


@pytest.mark.parametrize("page", ["networks.md", "custom-policies.md"])
def test_a_page_prints_what_it_says(tmp_path, page):
    check_guide((ROOT / "docs" / page).read_text(encoding="utf-8"), tmp_path)


def test_the_page_from_a_set_to_a_table_runs(tmp_path):
    """At a small size: a tenth of the episodes and of the steps, on one thread."""
    text = (ROOT / "docs/train-offline.md").read_text(encoding="utf-8")
    text = text.replace('"episodes": 10', '"episodes": 1').replace("STEPS = 100 ", "STEPS = 10 ")
    (tmp_path / "page.md").write_text(text, encoding="utf-8")
    command = [sys.executable, str(ROOT / "scripts/guide"), "page.md"]
    env = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=env)
    assert done.returncode == 0, done.stderr
    assert "What was played again is the same as table.json" in done.stderr
    table = (tmp_path / "table.tex").read_text(encoding="utf-8")
    assert "bc & 3 & $-$" in table
    assert "iql & 3 & $-$" in table
