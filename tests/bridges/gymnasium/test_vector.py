"""The vector environment does what Gymnasium's loop over single ones does, in all three modes of reset."""

from __future__ import annotations

import json

import gymnasium
import numpy as np
import pytest

import ibdata
from ibdata.environment.vector import MODES, IndustrialBenchmarkVectorEnv
from ibdata.errors import UsageError

ID = "ibdata/IndustrialBenchmark-v0"
STEPS = 7
LANES = 3
SETTINGS = (
    {"setpoint": 70},
    {"setpoint": "drifting", "start": {"burn_in": [0, 9]}, "history": 2, "view": {"reward_scale": 0.1}},
    {"start": "uniform", "dynamics": "paper", "discrete_actions": True},
    {"view": {"reward": "delta", "actions": True}},
)
HAS_MODES = hasattr(gymnasium.vector, "AutoresetMode")  # 1.0 knows NextStep only, without the name


def made(mode="NextStep", steps=STEPS, **given):
    options = {"setpoint": 70, **given}
    return gymnasium.make_vec(ID, num_envs=LANES, max_episode_steps=steps, autoreset_mode=mode, **options)


def actions(steps):
    return np.random.default_rng(0).uniform(-1, 1, (steps, LANES, 3)).astype(np.float32)


def equal(a, b):
    """Whether two infos are equal: dictionaries of arrays, arrays of arrays or None."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(equal(a[key], b[key]) for key in a)
    if a.dtype == object:
        return all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))
    return a.dtype == b.dtype and np.array_equal(a, b)


def same(ours, theirs):
    *parts, info = ours
    *others, other = theirs
    for a, b in zip(parts, others, strict=True):
        assert (a.dtype, a.shape) == (b.dtype, b.shape)
        assert np.array_equal(a, b)
    assert equal(info, other)


@pytest.mark.parametrize("given", SETTINGS, ids=str)
@pytest.mark.parametrize("mode", MODES if HAS_MODES else MODES[:1])
def test_it_does_what_gymnasium_s_loop_does_bit_for_bit(mode, given):
    """With resets by hand, the lanes' episodes end at different steps."""
    ours = made(mode, **given)
    theirs = gymnasium.make_vec(
        ID,
        num_envs=LANES,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": mode} if HAS_MODES else {},
        max_episode_steps=STEPS,
        **{"setpoint": 70, **given},
    )
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    same(ours.reset(seed=4), theirs.reset(seed=4))
    ours.action_space.seed(0)
    for t in range(3 * STEPS):
        action = ours.action_space.sample()
        step = ours.step(action)
        same(step, theirs.step(action))
        ended = step[3] | np.array([False, t == 3, False])
        if mode == "Disabled" and ended.any():
            options = {"reset_mask": ended}
            same(ours.reset(options=options), theirs.reset(options=options))
    same(ours.reset(seed=[1, 5, 9]), theirs.reset(seed=[1, 5, 9]))
    same(ours.reset(), theirs.reset())


def test_a_lane_s_numbers_do_not_depend_on_when_others_begin():
    """Also over many refills of the integers read ahead."""
    env = made("Disabled", steps=10**6)
    alone = gymnasium.make(ID, setpoint=70, max_episode_steps=10**6)
    env.reset(seed=0)
    alone.reset(seed=1)
    for t, action in enumerate(actions(400)):
        if t % 7 == 3:
            env.reset(options={"reset_mask": np.array([True, False, t % 2 == 0])})
        assert np.array_equal(env.step(action)[0][1], alone.step(action[1])[0])


@pytest.mark.parametrize("mode", MODES)
def test_what_is_returned_is_never_changed_afterwards(mode):
    env = made(mode, steps=2)
    seen, info = env.reset(seed=0)
    kept = [seen, info["latent_mu_v"]]
    copies = [x.copy() for x in kept]
    for action in actions(6):
        *parts, info = env.step(action)
        new = [*parts, info["latent_theta_1"], info["_latent_mu_g"]]
        kept += new
        copies += [x.copy() for x in new]
        ended = copies[-3]
        if mode == "Disabled" and ended.any():
            env.reset(options={"reset_mask": ended})
    assert all(np.array_equal(x, y) for x, y in zip(kept, copies, strict=True))


def test_metadata_seeds_and_spec():
    env = made("SameStep")
    mode = env.metadata["autoreset_mode"]
    assert getattr(mode, "value", mode) == "SameStep"
    assert not HAS_MODES or isinstance(mode, gymnasium.vector.AutoresetMode)
    assert not HAS_MODES or made(mode).metadata["autoreset_mode"] == mode
    env.reset(seed=11)
    assert env.np_random_seed == (11, 12, 13)
    assert len(env.np_random) == LANES
    assert json.loads(env.spec.to_json())["kwargs"]["autoreset_mode"] == "SameStep"
    assert len(set(made().np_random_seed)) == LANES


def begin(env):
    env.reset(seed=0)
    return env


@pytest.fixture
def begun():
    return begin(made("Disabled", steps=2))


STATE = ibdata.dynamics.initial_state([70.0])
MASK = r"reset_mask: found .*, expected a boolean array of shape \(3,\) that is true for some lane$"
LANES_LEFT = "lanes: found .*, expected (one of 0 to 2|whole numbers|different ones)$"
REFUSED = {
    "a mode": (lambda env: made("next"), "autoreset_mode: found 'next', expected one of NextStep, SameStep"),
    "no step": (lambda env: made(steps=0), "max_episode_steps: found 0, expected a whole number"),
    "no lane": (lambda env: IndustrialBenchmarkVectorEnv(0), "num_envs: found 0, expected at least 1$"),
    "two seeds": (lambda env: env.reset(seed=[1, 2]), "seed: found 2 seeds, expected 3$"),
    "two actions": (
        lambda env: env.step(np.zeros((2, 3))),
        r"action: found .*, expected \(3, 3\) finite numbers",
    ),
    "discrete actions": (
        lambda env: begin(made(discrete_actions=True)).step(np.zeros((3, 3))),
        "action: found .*, expected 3 whole numbers from 0 to 26$",
    ),
    "a state for all": (
        lambda env: env.unwrapped.set_state(STATE),
        "set_state: found a state of 1 lane, expected a state of 3 lanes$",
    ),
    **{
        f"the mask {mask}": (lambda env, mask=mask: env.reset(options={"reset_mask": mask}), MASK)
        for mask in ([True] * 3, np.ones(2, dtype=bool), np.ones(3), np.zeros(3, dtype=bool))
    },
    **{
        f"the lanes {lanes}": (lambda env, lanes=lanes: env.unwrapped.set_state(STATE, lanes), LANES_LEFT)
        for lanes in (3, -1, [0, 0], [], [0.0], "all", [[0]])
    },
}


@pytest.mark.parametrize(("call", "message"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_meant_is_refused_in_one_line(begun, call, message):
    with pytest.raises(UsageError, match=f"^{message}"):
        call(begun)


def test_a_step_needs_a_running_episode_in_every_lane(begun):
    for action in actions(2):
        begun.step(action)
    for env in (begun, made()):
        with pytest.raises(gymnasium.error.ResetNeeded):
            env.step(actions(1)[0])
