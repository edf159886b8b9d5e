"""The `VecEnv` of ibdata gives what Stable-Baselines3 makes of single environments, and trains its models."""

import copy

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.wrappers import NormalizeObservation, NormalizeReward
from helpers import ROOT
from helpers.pages import blocks
from stable_baselines3 import DQN, PPO, SAC
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecMonitor, VecNormalize

import ibdata
from ibdata.environment.sb3 import IndustrialBenchmarkVecEnv
from ibdata.errors import UsageError
from ibdata.policies.libraries import environment_note

ID = "ibdata.environment:ibdata/IndustrialBenchmark-v0"
LANES, STEPS = 3, 7
SETTINGS = (
    {"setpoint": 70},
    {"setpoint": "drifting", "start": {"burn_in": [0, 9]}, "history": 2, "view": {"reward_scale": 0.1}},
    {"start": "uniform", "dynamics": "paper", "discrete_actions": True},
    {"view": {"actions": True, "reward": "delta", "imperfections": {"missing": {"obs_fatigue": 0.5}}}},
    {"start": {"burn_in": [0, 9]}, "history": 4, "view": {"imperfections": {"noise": {"obs_fatigue": 1.0}}}},
)


@pytest.fixture(autouse=True, scope="module")
def _one_thread():
    torch.set_num_threads(1)


def both(**given):
    ours = IndustrialBenchmarkVecEnv(LANES, max_episode_steps=STEPS, **given)
    theirs = DummyVecEnv([lambda: gymnasium.make(ID, max_episode_steps=STEPS, **given)] * LANES)
    return ours, theirs


def actions_for(env, steps=3 * STEPS):
    env.action_space.seed(0)
    return [np.array([env.action_space.sample() for _ in range(LANES)]) for _ in range(steps)]


def check_arrays(found, expected):
    assert (found.dtype, found.shape) == (expected.dtype, expected.shape)
    np.testing.assert_array_equal(found, expected)


def check_infos(infos, theirs):
    """They say whether an episode was cut, and what was seen last; no hidden states."""
    assert len(infos) == len(theirs)
    for own, other in zip(infos, theirs, strict=True):
        assert own.keys() == other.keys() & {"TimeLimit.truncated", "terminal_observation"}
        for key, value in own.items():
            np.testing.assert_array_equal(value, other[key])
            assert type(value) is type(other[key])


def check_begin(a, b):
    check_arrays(a.reset(), b.reset())


def check_alike(a, b, actions):
    """Both give the same, bit for bit and type for type, and what was returned is never changed."""
    steps = [a.step(action) for action in actions]
    others = [copy.deepcopy(b.step(action)) for action in actions]
    for (*arrays, infos), (*their_arrays, their_infos) in zip(steps, others, strict=True):
        for own, other in zip(arrays, their_arrays, strict=True):
            check_arrays(own, other)
        check_infos(infos, their_infos)


@pytest.mark.parametrize("given", SETTINGS)
def test_it_gives_the_bits_of_a_loop_over_environments(given):
    a, b = both(**given)
    assert (a.observation_space, a.action_space) == (b.observation_space, b.action_space)
    assert a.seed(4) == b.seed(4)
    check_begin(a, b)
    check_alike(a, b, actions_for(a))
    check_begin(a, b)  # a seed holds for one reset
    check_alike(a, b, actions_for(a, 2))


def test_options_replay_episodes_and_hold_for_one_reset(tmp_path):
    experiment = ibdata.Experiment(name="x", setpoints=[20, 70], policies=["random"], episodes=2, steps=9)
    ds = ibdata.generate(experiment, tmp_path / "data", workers=1)
    rewards = ds.arrays()["rewards"].reshape(4, 9)
    actions = ds.arrays()["actions"].reshape(4, 9, 3)
    a, b = both(setpoint=50)
    for env in (a, b):
        env.seed(0)
        env.set_options([{"dataset": ds, "episode": 3}, {}, {"dataset": str(ds.path), "episode": 0}])
    check_begin(a, b)
    given = actions[[3, 1, 0]].transpose(1, 0, 2)[:STEPS]
    made = np.array([a.step(action)[1] for action in given]).T
    np.testing.assert_array_equal(made[[0, 2]], rewards[[3, 0], :STEPS])
    assert (made[1] != rewards[1, :STEPS]).all()
    for action in given:
        b.step(action)
    check_alike(a, b, actions_for(a))  # without the options


@pytest.mark.parametrize("kind", [SAC, PPO], ids=lambda kind: kind.__name__)
def test_training_gives_the_same_network_as_over_their_loop(kind):
    small = {"policy_kwargs": {"net_arch": [16]}, "batch_size": 32, "seed": 1, "device": "cpu"}
    small |= {"n_steps": 32, "n_epochs": 2} if kind is PPO else {"learning_starts": 60, "train_freq": 4}
    learned = []
    for env in both(setpoint=70, history=2, view={"reward_scale": 0.01}):
        model = kind("MlpPolicy", VecMonitor(env), **small)
        first = next(model.policy.parameters()).detach().clone()
        model.learn(200)
        last = next(model.policy.parameters()).detach()
        assert not torch.equal(first, last)
        assert model.ep_info_buffer[0]["l"] == STEPS
        learned.append(last)
        assert np.isfinite(evaluate_policy(model, env, n_eval_episodes=3, warn=False)[0])
    assert torch.equal(*learned)


def model_in(env, kind=PPO):
    return kind("MlpPolicy", env, seed=0, device="cpu")


@pytest.mark.parametrize("loop", [DummyVecEnv, SubprocVecEnv])
def test_wrappers_are_known_in_every_process(loop):
    for wrapper, is_known in ((NormalizeReward, True), (NormalizeObservation, False)):
        env = make_vec_env(ID, n_envs=2, wrapper_class=wrapper, vec_env_cls=loop)
        model = model_in(VecNormalize(env))
        if is_known:
            assert environment_note(model) is None
        else:
            with pytest.raises(ibdata.IbdataError, match="found the wrapper NormalizeObservation"):
                ibdata.evaluate(model.predict, episodes=2, steps=2)
        env.close()
    if loop is SubprocVecEnv:
        assert "have ended" in environment_note(model)


def test_a_scaling_that_stayed_behind_is_said(tmp_path):
    env = VecNormalize(DummyVecEnv([lambda: gymnasium.make(ID)]))
    env.obs_rms.mean, env.obs_rms.var = np.full(6, 50.0), np.full(6, 900.0)
    model = model_in(env)
    model.save(tmp_path / "ppo.zip")
    loaded = PPO.load(tmp_path / "ppo.zip", device="cpu")
    few = {"episodes": 3, "steps": 20}
    own, lost = ibdata.evaluate(model, **few), ibdata.evaluate(loaded, **few)
    assert own.notes == []
    [note] = lost.notes
    assert note.startswith("ppo: the model has no environment, so it is given observations as they are; ")
    assert (own.returns != lost.returns).all()
    with pytest.raises(UsageError, match=r"^model: found no environment, which keeps VecNormalize"):
        ibdata.save_network(tmp_path / "actor.safetensors", loaded)
    [policy] = ibdata.evaluate(model.policy, **few).notes
    assert policy.startswith("actorcriticpolicy: a policy has no environment, so it is given observations")
    assert "set_env" not in policy  # which it does not have
    loaded.set_env(env)
    again = ibdata.evaluate(loaded, **few)
    assert again.returns.tolist() == own.returns.tolist()
    assert again.notes == []


def test_discrete_actions_are_those_of_the_environment():
    model = model_in(gymnasium.make(ID, discrete_actions=True), DQN)
    table = ibdata.policies.distributions.DISCRETE

    def spelt_out(observations):
        return np.array(table)[model.predict(observations, deterministic=True)[0]]

    found = ibdata.evaluate([model, spelt_out], episodes=3, steps=20)
    assert found.returns[0].tolist() == found.returns[1].tolist()


def test_the_snippet_of_the_page_runs(tmp_path, monkeypatch):
    page = (ROOT / "docs/environment.md").read_text(encoding="utf-8")
    [block] = [code for code in blocks(page, "python") if "stable_baselines3" in code]
    names: dict = {}
    monkeypatch.chdir(tmp_path)
    exec(block.replace("120_000", "2_000"), names)
    assert names["model"].num_timesteps == 64 * 32
    assert [path.name for path in tmp_path.iterdir()] == ["actor.safetensors"]
