"""Views in the simulation behind the environments."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ibdata.environment.lane import Lane
from ibdata.environment.settings import frame_bounds, settings
from ibdata.environment.simulation import Simulation
from ibdata.errors import UsageError

VIEWS = {
    "markov": {"history": 3, "view": {"observe": "markov", "actions": True}},
    "troubles": {
        "view": {
            "imperfections": {
                "delay": {"obs_fatigue": 2},
                "noise": {"obs_consumption": 1.0},
                "missing": {"obs_velocity": 0.3},
                "mask": True,
            }
        }
    },
    "derived": {"view": {"observe": ["latent_penalty", "obs_gain"], "reward": "delta", "reward_scale": 0.5}},
    "scaled": {"view": {"reward_scale": 0.01}},
    "drifting": {"setpoint": "drifting", "view": {"observe": "markov", "reward": {"fatigue": 1}}},
}


def drawing(seed):
    """Random integers of lanes, each with a stream of its own."""
    streams = [np.random.Generator(np.random.PCG64(seed + i)) for i in range(9)]

    def draw(which, purpose, step, steps, slots):
        drawn = [streams[i].integers(0, 2**64, slots, dtype=np.uint64) for i in which.tolist()]
        return np.stack(drawn, axis=1)[None]

    return draw


@pytest.mark.parametrize("options", VIEWS.values(), ids=VIEWS)
def test_one_lane_sees_what_it_sees_among_others(options):
    given = settings(**options)
    many, one = Simulation(given, 3), Lane(given)
    draws, own = drawing(5), drawing(6)
    everyone, alone = np.arange(3), np.array([0])
    many.reset(everyone, draws)
    one.reset(alone, own)
    actions = np.random.default_rng(1).uniform(-1, 1, (9, 3, 3)).astype(np.float32)
    for action in actions:
        rewards = many.step(everyone, action, draws)
        seen, reward, info = one.move(tuple(action[1].tolist()), own(alone, None, 0, 1, one.draws)[0, :, 0])
        assert (seen == many.observations()[1]).all()
        assert reward == pytest.approx(rewards[1], rel=1e-15)
        assert info == {name: values[1] for name, values in many.info().items()}


@pytest.mark.parametrize("options", VIEWS.values(), ids=VIEWS)
def test_what_is_seen_lies_within_the_bounds(options):
    given = settings(**options)
    low, high = (np.tile(bounds, given.history) for bounds in frame_bounds(given))
    simulation, draw = Simulation(given, 4), drawing(2)
    simulation.reset(np.arange(4), draw)
    for _ in range(20):
        simulation.step(np.arange(4), np.ones((4, 3), dtype=np.float32), draw)
        seen = simulation.observations()
        assert ((low <= seen) & (seen <= high)).all()


def test_clean_values_stay_in_the_info():
    given = settings(**VIEWS["troubles"])
    simulation, draw = Simulation(given, 2), drawing(3)
    simulation.reset(np.arange(2), draw)
    for _ in range(4):
        simulation.step(np.arange(2), np.ones((2, 3), dtype=np.float32), draw)
    info = simulation.info()
    assert (info["clean_obs_consumption"] == simulation.seen[:, 0, 5]).all()
    assert not (simulation.observations()[:, 5] == simulation.seen[:, 0, 5]).any()
    assert {name for name in info if name.startswith("clean_")} == {
        "clean_obs_fatigue",
        "clean_obs_consumption",
        "clean_obs_velocity",
    }


def test_a_view_without_noise_takes_no_random_numbers():
    plain, viewed = Simulation(settings(), 2), Simulation(settings(view={"observe": "markov"}), 2)
    for simulation in (plain, viewed):
        draw = drawing(8)
        simulation.reset(np.arange(2), draw)
        simulation.step(np.arange(2), np.zeros((2, 3), dtype=np.float32), draw)
    assert (viewed.observations()[:, :6] == plain.observations()).all()


def test_inexact_measurements_have_no_bounds():
    low, high = frame_bounds(settings(view={"imperfections": {"noise": {"obs_gain": 1.0}}}))
    assert (low[2], high[2]) == (-math.inf, math.inf)


def test_a_constant_setpoint_has_no_drift_to_see():
    with pytest.raises(UsageError, match="found latent_drift_rate, which only a moving setpoint has"):
        settings(view={"observe": ["latent_drift_rate"]})
