"""The environment passes Gymnasium's own checks and agrees with the dataset."""

from __future__ import annotations

import json
import subprocess
import sys
from itertools import pairwise

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from helpers.asking import proposed

import ibdata.environment
from ibdata.dynamics import PAPER
from ibdata.errors import ConfigError, UsageError
from ibdata.policies import OBSERVATION, POLICIES
from ibdata.simulation.variables import hidden

ID = "ibdata/IndustrialBenchmark-v0"
SETTINGS = (
    {},
    {"setpoint": 70},
    {"setpoint": "drifting", "start": {"burn_in": [0, 9]}, "history": 3},
    {"dynamics": {"base": "paper", "eta_mean": 0.1}, "start": "uniform", "view": {"reward_scale": 0.01}},
    {"dynamics": PAPER, "setpoint": {"drifting": 99}},
)


class Tape:
    """Stands in for a generator: integers that were drawn elsewhere, in a row."""

    def __init__(self, integers):
        self.integers, self.at, self.bit_generator = integers, 0, self

    def random_raw(self, count):
        self.at += count
        return self.integers[self.at - count : self.at]


def episode(env, seed, steps=50):
    """All that comes out of an episode of random actions, as one list."""
    env.action_space.seed(seed)
    out = [env.reset(seed=seed)]
    out += [env.step(env.action_space.sample()) for _ in range(steps)]
    return [[x.tolist() if isinstance(x, np.ndarray) else x for x in part] for part in out]


@pytest.mark.parametrize(
    "order",
    [
        "import gymnasium",
        "import ibdata, gymnasium",
        "import gymnasium, ibdata",
        "import ibdata.environment, gymnasium",
    ],
)
def test_it_is_made_after_every_order_of_imports(order):
    code = f"{order}; print(gymnasium.make('ibdata.environment:{ID}', setpoint=70).reset(seed=0)[0][0])"
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("70.0\n", "")


@pytest.mark.parametrize(
    ("order", "name"),
    [("gymnasium", f"ibdata:{ID}"), ("gymnasium, ibdata", ID), ("ibdata.environment, gymnasium", ID)],
)
def test_a_shorter_name_will_do_once_it_is_registered(order, name):
    code = f"import {order}; print(gymnasium.make({name!r}).reset(seed=0)[0][0])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "70.0\n"


def test_import_ibdata_leaves_gymnasium_and_numpy_alone():
    code = "import ibdata, sys; print([m for m in ('gymnasium', 'numpy') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "[]\n"


@pytest.mark.parametrize("given", SETTINGS, ids=str)
def test_gymnasium_s_checker_passes_without_a_warning(given):
    """Warnings are errors in this suite."""
    check_env(gymnasium.make(ID, **given).unwrapped, skip_render_check=True)


@pytest.mark.parametrize("given", SETTINGS, ids=str)
def test_gymnasium_s_checker_and_wrappers_pass_an_episode(given):
    env = gymnasium.make(ID, max_episode_steps=30, **given)
    env.action_space.seed(0)
    seen, _ = env.reset(seed=0)
    assert seen.shape == (6 * given.get("history", 1),)
    for t in range(30):
        seen, reward, terminated, truncated, _ = env.step(env.action_space.sample())
        assert seen in env.observation_space
        assert seen.dtype == np.float32
        assert type(reward) is float
        assert (terminated, truncated) == (False, t == 29)


def test_episodes_have_1000_steps_unless_said_otherwise():
    assert gymnasium.spec(ID).max_episode_steps == 1000
    assert gymnasium.make(ID, max_episode_steps=7).spec.max_episode_steps == 7


def test_its_spec_is_json_and_makes_it_again():
    env = gymnasium.make(
        ID, setpoint=70, dynamics={"base": "paper", "eta_mean": 0.1}, start={"burn_in": [1, 2]}
    )
    text = env.spec.to_json()
    assert json.loads(text)["entry_point"] == "ibdata.environment:IndustrialBenchmarkEnv"
    again = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(text))
    assert episode(again, 3) == episode(env, 3)


@pytest.mark.parametrize("given", SETTINGS, ids=str)
def test_a_seed_names_an_episode_and_no_seed_goes_on(given):
    env = gymnasium.make(ID, **given)
    first, other = episode(env, 1), episode(env, 2)
    assert first != other
    env.reset(seed=9)
    np.random.seed(0)  # noqa: NPY002 - the global generator has no say
    assert episode(env, 1) == first
    assert env.reset()[0].tolist() != env.reset()[0].tolist()


def test_two_environments_do_not_disturb_each_other():
    a, b = (gymnasium.make(ID, start="uniform") for _ in range(2))
    alone = episode(a, 5)
    b.reset(seed=1)
    a.action_space.seed(5)
    seen = [a.reset(seed=5)[0].tolist()]
    for _ in range(50):
        b.step(b.action_space.sample())
        seen.append(a.step(a.action_space.sample())[0].tolist())
    assert seen == [part[0] for part in alone]


def test_the_first_episode_of_seed_0_stays_as_it_is():
    """PCG64's integers are promised stable and the rest is exact: the same on any machine and version.

    Made by these lines, with gymnasium 1.4.0 and numpy 2.4.6.
    """
    env = gymnasium.make(ID, setpoint=70)
    seen, _ = env.reset(seed=0)
    assert seen.tolist() == [70.0, 50.0, 50.0, 50.0, 33.015926361083984, 118.99102020263672]
    rewards = [env.step(np.array([1, -1, 0.5], dtype=np.float32))[1] for _ in range(20)]
    assert rewards[-1] == float.fromhex("-0x1.b60903b4b479ap+7")


def test_an_episode_equals_the_dataset_s_with_its_noise(case, recorded):
    env = gymnasium.make(ID, **case)
    env.reset(seed=0)
    env.unwrapped.np_random = tape = Tape(recorded.integers)
    columns = recorded.columns
    names = hidden(drifting=isinstance(case["setpoint"], dict))
    seen, info = env.reset()
    for t in range(len(columns["reward"])):
        assert seen.tolist() == [columns[f"obs_{name}"][t] for name in OBSERVATION]
        assert {name: np.float32(value) for name, value in info.items()} == {
            f"latent_{name}": columns[f"latent_{name}"][t] for name in names
        }
        action = np.array([columns[f"act_{name}"][t] for name in ("velocity", "gain", "shift")])
        seen, reward, _, _, info = env.step(action)
        assert np.float32(reward) == columns["reward"][t]
        assert seen.tolist() == [columns[f"next_obs_{name}"][t] for name in OBSERVATION]
    assert tape.at == len(recorded.integers)


def test_wrong_settings_and_actions_are_refused_in_one_line():
    with pytest.raises(ConfigError, match=r"^setpoint: found 170, expected a number of at most 100$"):
        gymnasium.make(ID, setpoint=170)
    env = ibdata.environment.IndustrialBenchmarkEnv()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(3, dtype=np.float32))
    env.reset(seed=0)
    for action in ([0, 0, np.nan], [0, 0], None):
        with pytest.raises(UsageError, match=r"^action: found .*, expected three finite numbers"):
            env.step(action)
    with pytest.raises(UsageError, match=r"^render: found render_mode None"):
        env.render()
    with pytest.raises(UsageError, match=r"^render_mode: found 'human', expected rgb_array or None$"):
        ibdata.environment.IndustrialBenchmarkEnv(render_mode="human")


def test_rendering_draws_the_episode_so_far_and_needs_no_window():
    env = gymnasium.make(ID, setpoint=70, render_mode="rgb_array")
    env.reset(seed=0)
    frames = [env.render()]
    for _ in range(3):
        env.step(env.action_space.sample())
        frames.append(env.render())
    assert all((frame.shape, frame.dtype) == ((600, 900, 3), np.uint8) for frame in frames)
    assert all((a != b).any() for a, b in pairwise(frames))
    assert np.array_equal(env.render(), frames[-1])
    assert "matplotlib.pyplot" not in sys.modules
    env.reset(seed=0)
    assert np.array_equal(env.render(), frames[0])


def test_gymnasium_s_checker_passes_with_rendering():
    check_env(gymnasium.make(ID, setpoint=70, render_mode="rgb_array").unwrapped)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    experiment = ibdata.Experiment(
        name="made", setpoints=70, policies=[{"kind": "random"}], start="uniform", episodes=3, steps=40
    )
    return ibdata.generate(experiment, tmp_path_factory.mktemp("made") / "data", workers=1)


def test_it_goes_on_from_the_state_of_a_row(made):
    rows = made.to_pandas().query("episode == 2 and step >= 25").reset_index(drop=True)
    env = gymnasium.make(ID, setpoint=10, history=2)
    env.reset(seed=0)
    seen, info = env.unwrapped.set_state(ibdata.state_at(made, (2, 25)))
    stored = rows[[f"obs_{name}" for name in OBSERVATION]].to_numpy()
    np.testing.assert_array_equal(seen, np.tile(stored[0], 2))
    assert set(info) == {f"latent_{name}" for name in hidden(False)}
    assert all(np.float32(value) == rows[name][0] for name, value in info.items())
    for t, action in enumerate(rows[["act_velocity", "act_gain", "act_shift"]].to_numpy()[:-1]):
        seen, *_ = env.step(action)  # setpoint, velocity, gain and shift have no noise
        np.testing.assert_array_equal(seen[:4], stored[t + 1, :4])
        np.testing.assert_array_equal(seen[6:10], stored[t, :4])


def test_the_returns_of_its_episodes_are_the_true_values(made):
    """From three states, 300 returns each: within 4 standard errors of both."""
    policy = POLICIES["mediocre"]()
    truth = ibdata.true_values(made, [5, 55, 110], policy, steps=30, episodes=300)
    env = gymnasium.make(ID, setpoint=70)
    env.reset(seed=0)
    for row, result in zip([5, 55, 110], truth.results, strict=True):
        state, returns = ibdata.state_at(made, divmod(row, 40)), np.zeros(300)
        for i in range(300):
            seen, _ = env.unwrapped.set_state(state)
            for t in range(30):
                seen, reward, *_ = env.unwrapped.step(proposed(policy, seen[None, None], np.empty((1, 0)))[0])
                returns[i] += 0.97**t * reward
        error = np.hypot(returns.std(ddof=1) / np.sqrt(300), result.standard_error)
        assert abs(returns.mean() - result.value) < 4.0 * error
