"""The vector environment does what Gymnasium's loop over single ones does, in all three modes of reset."""

import gymnasium
import numpy as np
import pytest
from helpers.refusals import refused

import ibdata
from ibdata.environment.vector import MODES

pytestmark = pytest.mark.portable

ID = "ibdata/IndustrialBenchmark-v0"
STEPS = 30  # three episodes: past the integers that are read ahead
LANES = 3
TROUBLES = {"delay": {"obs_gain": 2}, "missing": {"obs_fatigue": 0.5}, "noise": {"obs_velocity": 1.0}}
SETTINGS = (
    {"setpoint": 70},
    {"setpoint": "drifting", "start": {"burn_in": [0, 9]}, "history": 2, "view": {"reward_scale": 0.1}},
    {"start": "uniform", "dynamics": "paper", "discrete_actions": True},
    {"view": {"reward": "delta", "actions": True, "cost": {"fatigue": 30}}},
    {"start": {"burn_in": [0, 9]}, "history": 4, "view": {"actions": True, "imperfections": TROUBLES}},
)
HAS_MODES = hasattr(gymnasium.vector, "AutoresetMode")  # 1.0 knows NextStep only, without the name


def made(mode="NextStep", steps=STEPS, **given):
    options = {"setpoint": 70, **given}
    return gymnasium.make_vec(ID, num_envs=LANES, max_episode_steps=steps, autoreset_mode=mode, **options)


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


@pytest.mark.parametrize("given", SETTINGS)
@pytest.mark.parametrize("mode", MODES if HAS_MODES else MODES[:1])
def test_it_does_what_gymnasium_s_loop_does_bit_for_bit(mode, given):
    """With resets by hand, the lanes' episodes end at different steps. Nothing returned is changed later."""
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
    pairs = [(ours.reset(seed=4), theirs.reset(seed=4))]
    ours.action_space.seed(0)
    for t in range(3 * STEPS):
        action = ours.action_space.sample()
        step = ours.step(action)
        pairs.append((step, theirs.step(action)))
        ended = step[3] | np.array([False, t == 3, False])
        if mode == "Disabled" and ended.any():
            options = {"reset_mask": ended.copy()}
            pairs.append((ours.reset(options=options), theirs.reset(options=options)))
    pairs.append((ours.reset(seed=[1, 5, 9]), theirs.reset(seed=[1, 5, 9])))
    for pair in [*pairs, (ours.reset(), theirs.reset())]:
        same(*pair)


@pytest.mark.parametrize("mode", MODES if HAS_MODES else MODES[:1])
def test_the_costs_of_an_episode_are_those_of_its_steps(mode):
    """By hand: whether the fatigue after each step is above 30. A start is no step, so it costs nothing."""
    env = made(mode, steps=5, view={"cost": {"fatigue": 30}})
    assert env.reset(seed=0)[1]["cost"].tolist() == [0.0] * LANES
    paid = expected = starts = 0
    begins = False
    for _ in range(60):
        seen, _, _, ended, info = env.step(np.zeros((LANES, 3), dtype=np.float32))
        starts += begins * np.count_nonzero(seen[:, 4] > 30)
        paid += info["cost"].sum()
        if mode == "SameStep" and ended.all():
            assert not info["cost"].any()
            paid, seen = paid + info["final_info"]["cost"].sum(), np.stack(info["final_obs"])
        expected += (not begins) * np.count_nonzero(seen[:, 4] > 30)
        begins = mode == "NextStep" and ended.all()
        if mode == "Disabled" and ended.all():
            assert not env.reset(options={"reset_mask": ended})[1]["cost"].any()
    assert paid == expected > 5
    assert (starts > 0) == (mode == "NextStep")  # which would have been counted too


STATE = ibdata.dynamics.initial_state([70.0])
MASK = r"reset_mask: found .*, expected a boolean array of shape \(3,\) that is true for some lane$"
LANES_LEFT = "lanes: found .*, expected (one of 0 to 2|whole numbers|different ones)$"
REFUSED = {
    "a mode": (lambda env: made("next"), "autoreset_mode: found 'next', expected one of NextStep, SameStep"),
    "an unknown option": (
        lambda env: gymnasium.make_vec(ID, setpoints=70),
        "setpoints: got an unexpected keyword argument 'setpoints'; did you mean 'setpoint'",
    ),
    "0 steps": (lambda env: made(steps=0), "max_episode_steps: found 0, expected a whole number of at lea"),
    "two seeds": (lambda env: env.reset(seed=[1, 2]), "seed: found 2 seeds, expected 3$"),
    "a negative seed": (lambda env: env.reset(seed=[1, 2, -3]), "seed: found -3, expected a whole number"),
    "seeds of text": (lambda env: env.reset(seed="123"), "seed: found '123', expected a whole number, a l"),
    "no lanes": (lambda env: gymnasium.make_vec(ID, num_envs=0), "num_envs: found 0, expected a whole num"),
    "two actions": (
        lambda env: env.step(np.zeros((2, 3))),
        r"action: found .*, expected \(3, 3\) finite num",
    ),
    "a state for all": (
        lambda env: env.unwrapped.set_state(STATE),
        "set_state: found a state of 1 lane, exp",
    ),
    "a mask of numbers": (lambda env: env.reset(options={"reset_mask": np.ones(3)}), MASK),
    "an empty mask": (lambda env: env.reset(options={"reset_mask": np.zeros(3, dtype=bool)}), MASK),
    "no lane": (lambda env: env.unwrapped.set_state(STATE, 3), LANES_LEFT),
    "a lane twice": (lambda env: env.unwrapped.set_state(STATE, [0, 0]), LANES_LEFT),
    "a lane of another type": (lambda env: env.unwrapped.set_state(STATE, [0.0]), LANES_LEFT),
}


@pytest.mark.parametrize(("call", "message"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_meant_is_refused_in_one_line(call, message):
    env = made("Disabled")
    env.reset(seed=0)
    refused(f"^{message}", call, env)
