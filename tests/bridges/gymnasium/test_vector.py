"""Each lane of the vector environment behaves as one environment, in all three modes of reset."""

from __future__ import annotations

import json

import gymnasium
import numpy as np
import pytest

import ibdata.environment  # noqa: F401 - registers the environment
from ibdata.environment.vector import MODES, IndustrialBenchmarkVectorEnv
from ibdata.errors import UsageError

ID = "ibdata/IndustrialBenchmark-v0"
STEPS = 7
LANES = 3
SETTINGS = (
    {"setpoint": 70},
    {"setpoint": "drifting", "start": {"burn_in": [0, 9]}, "history": 2, "view": {"reward_scale": 0.1}},
    {"start": "uniform", "dynamics": "paper"},
    {"view": {"reward": "delta", "actions": True}},
)
HAS_MODES = hasattr(gymnasium.vector, "AutoresetMode")  # 1.0 knows NextStep only, without the name


def made(mode="NextStep", lanes=LANES, steps=STEPS, **given):
    return gymnasium.make_vec(
        ID, num_envs=lanes, max_episode_steps=steps, autoreset_mode=mode, **given or {"setpoint": 70}
    )


def actions(steps, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, (steps, LANES, 3)).astype(np.float32)


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
    ours = made(mode, **given)
    theirs = gymnasium.make_vec(
        ID,
        num_envs=LANES,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": mode} if HAS_MODES else {},
        max_episode_steps=STEPS,
        **given,
    )
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    same(ours.reset(seed=4), theirs.reset(seed=4))
    for action in actions(3 * STEPS):
        step = ours.step(action)
        same(step, theirs.step(action))
        if mode == "Disabled" and step[3].any():
            mask = step[3]
            same(ours.reset(options={"reset_mask": mask}), theirs.reset(options={"reset_mask": mask}))
    same(ours.reset(seed=[1, 5, 9]), theirs.reset(seed=[1, 5, 9]))
    same(ours.reset(), theirs.reset())


@pytest.mark.parametrize("given", SETTINGS, ids=str)
def test_a_lane_is_the_environment_of_its_seed(given):
    ours = made(steps=50, **given)
    alone = [gymnasium.make(ID, **given) for _ in range(LANES)]
    seen = ours.reset(seed=4)[0]
    assert np.array_equal(seen, [env.reset(seed=4 + i)[0] for i, env in enumerate(alone)])
    for action in actions(50):
        seen, rewards, *_ = ours.step(action)
        steps = [env.step(a) for env, a in zip(alone, action, strict=True)]
        assert np.array_equal(seen, [step[0] for step in steps])
        assert rewards.tolist() == [step[1] for step in steps]


def test_next_step_gives_a_row_that_begins_the_next_episode():
    env = made("NextStep")
    env.reset(seed=0)
    rows = [env.step(action) for action in actions(STEPS + 2)]
    assert [row[3].all() for row in rows] == [False] * (STEPS - 1) + [True, False, False]
    assert rows[STEPS][1].tolist() == [0.0] * LANES
    assert (rows[STEPS][0][:, 1:4] == 50.0).all()
    assert (rows[STEPS + 1][1] != 0.0).all()


def test_same_step_has_the_last_observation_in_the_info():
    same_step, disabled = made("SameStep"), made("Disabled")
    for env in (same_step, disabled):
        env.reset(seed=0)
    for t, action in enumerate(actions(STEPS)):
        seen, rewards, _, truncated, info = same_step.step(action)
        last, their_rewards, _, _, hidden = disabled.step(action)
        assert np.array_equal(rewards, their_rewards)
        assert ("final_obs" in info) == truncated.all() == (t == STEPS - 1)
    assert np.array_equal(np.stack(info["final_obs"]), last)
    assert equal(info["final_info"], hidden)
    assert (seen[:, 1:4] == 50.0).all()


def test_disabled_leaves_it_to_the_caller_lane_by_lane():
    env = made("Disabled", steps=4)
    env.reset(seed=0)
    env.step(actions(1)[0])
    mask = np.array([True, False, False])
    seen, info = env.reset(options={"reset_mask": mask})
    assert seen[0, 1:4].tolist() == [50.0] * 3
    assert info["_latent_mu_v"].tolist() == mask.tolist()
    assert info["latent_mu_v"][1:].tolist() == [0.0, 0.0]
    ends = [env.step(action)[3].tolist() for action in actions(3)]
    assert ends == [[False] * 3, [False] * 3, [False, True, True]]
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(actions(1)[0])
    env.reset(options={"reset_mask": ~mask})
    assert env.step(actions(1)[0])[3].tolist() == [True, False, False]


def test_a_lane_s_numbers_do_not_depend_on_when_the_others_begin():
    """Also over many refills of the integers read ahead."""
    env = made("Disabled", steps=10**6)
    alone = gymnasium.make(ID, setpoint=70, max_episode_steps=10**6)
    env.reset(seed=0)
    alone.reset(seed=1)
    for t, action in enumerate(actions(400)):
        if t % 7 == 3:
            env.reset(options={"reset_mask": np.array([True, False, t % 2 == 0])})
        assert np.array_equal(env.step(action)[0][1], alone.step(action[1])[0])


def test_what_is_returned_is_never_changed_afterwards():
    env = made("SameStep", steps=2)
    first = env.reset(seed=0)
    rows = [(first[0], first[1]["latent_mu_v"])]
    copies = [tuple(x.copy() for x in rows[0])]
    for action in actions(6):
        seen, rewards, terminated, truncated, info = env.step(action)
        rows.append((seen, rewards, terminated, truncated, info["latent_theta_1"], info["_latent_mu_g"]))
        copies.append(tuple(x.copy() for x in rows[-1]))
    assert all(
        np.array_equal(x, y) for a, b in zip(rows, copies, strict=True) for x, y in zip(a, b, strict=True)
    )


def test_metadata_seeds_and_spec():
    env = made("SameStep")
    mode = env.metadata["autoreset_mode"]
    assert getattr(mode, "value", mode) == "SameStep"
    assert not HAS_MODES or isinstance(mode, gymnasium.vector.AutoresetMode)
    env.reset(seed=11)
    assert env.np_random_seed == (11, 12, 13)
    assert len(env.np_random) == LANES
    assert json.loads(env.spec.to_json())["kwargs"]["autoreset_mode"] == "SameStep"
    seeds = made().np_random_seed
    assert len(set(seeds)) == LANES
    if HAS_MODES:
        assert made(gymnasium.vector.AutoresetMode.DISABLED).metadata["autoreset_mode"].value == "Disabled"


def test_what_cannot_be_meant_is_refused_in_one_line():
    with pytest.raises(
        UsageError, match=r"^autoreset_mode: found 'next', expected one of NextStep, SameStep, Dis"
    ):
        made("next")
    for limit in (0, -3, 2.5, True):
        with pytest.raises(UsageError, match=rf"^max_episode_steps: found {limit}, expected a whole number"):
            IndustrialBenchmarkVectorEnv(2, limit)
    with pytest.raises(UsageError, match=r"^num_envs: found 0, expected at least 1$"):
        made(lanes=0)
    with pytest.raises(UsageError, match=r"^history: found 0, expected a whole number of at least 1$"):
        made(history=0)
    env = made("NextStep")
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(actions(1)[0])
    for mask in ([True] * 3, np.ones(2, dtype=bool), np.ones(3), np.zeros(3, dtype=bool)):
        with pytest.raises(
            UsageError,
            match=r"^reset_mask: found .*, expected a boolean array of shape \(3,\) that is true for",
        ):
            env.reset(options={"reset_mask": mask})
    with pytest.raises(UsageError, match=r"^seed: found 2 seeds, expected 3$"):
        env.reset(seed=[1, 2])
    env.reset(seed=0)
    with pytest.raises(UsageError, match=r"^action: found .*, expected \(3, 3\) finite numbers"):
        env.step(np.zeros((2, 3), dtype=np.float32))
