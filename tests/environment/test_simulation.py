"""The lanes behind the environments and their random integers, without Gymnasium."""

from __future__ import annotations

import re

import numpy as np
import pytest
from helpers import by_hand
from helpers.refusals import refused

from ibdata._numerics.random import Purpose
from ibdata.dynamics import initial_state
from ibdata.environment.actions import continuous_action, continuous_actions
from ibdata.environment.settings import frame_bounds, settings
from ibdata.environment.simulation import Lane, Simulation
from ibdata.environment.streams import AHEAD, Streams
from ibdata.errors import UsageError
from ibdata.views.imperfections import KINDS
from ibdata.views.options import OBSERVED

pytestmark = pytest.mark.portable


class Tape:
    """Integers in a row for each lane, and how many were taken."""

    def __init__(self, integers):
        self.integers = np.atleast_2d(integers)
        self.at = np.zeros(len(self.integers), dtype=np.int64)

    def __call__(self, which, purpose, step, steps, slots):
        out = np.array([self.integers[lane, self.at[lane] : self.at[lane] + slots] for lane in which])
        self.at[which] += slots
        return np.ascontiguousarray(out.T)[None]


def random_tape(lanes, seed=0):
    return Tape(np.random.Philox(seed).random_raw(lanes * 4000).reshape(lanes, 4000))


TROUBLES = {"delay": {"obs_fatigue": 2}, "noise": {"obs_consumption": 1.0}, "missing": {"obs_velocity": 0.3}}
TROUBLES |= {"mask": True}
VIEWS = {
    "markov": {"history": 3, "view": {"observe": "markov", "actions": True}},
    "troubles": {"view": {"imperfections": TROUBLES}},
    "derived": {"view": {"observe": ["latent_penalty", "obs_gain"], "reward": "delta", "reward_scale": 0.5}},
    "drifting": {"setpoint": "drifting", "view": {"observe": "markov", "reward": {"fatigue": 1}}},
    "burn-in": {"start": {"burn_in": [0, 7]}, "history": 3, "view": {"reward_scale": 0.1}},
}


@pytest.mark.parametrize("options", VIEWS.values(), ids=VIEWS)
def test_the_environment_is_a_simulation_of_one_lane(options):
    """And what it sees lies within the bounds."""
    given = settings(**options)
    low, high = (np.tile(bounds, given.history) for bounds in frame_bounds(given))
    lane, simulation, tape, other = Lane(given), Simulation(given, 1), random_tape(1), random_tape(1)
    actions = np.random.default_rng(0).uniform(-1.2, 1.2, (60, 3))
    for t, action in enumerate(actions):
        if t % 20 == 0:
            lane.reset(lane.everyone, tape)
            simulation.reset(simulation.everyone, other)
        action = action if t % 2 else action.astype(np.float32)
        raw = tape(lane.everyone, None, 0, 1, lane.draws)[0, :, 0]
        seen, reward, info = lane.move(continuous_action(action), raw)
        [expected_reward] = simulation.step(simulation.everyone, continuous_actions([action], 1), other)
        assert seen.dtype == np.float32
        assert seen.tolist() == simulation.observations()[0].tolist()
        assert ((low <= seen) & (seen <= high)).all()
        assert (type(reward), reward) == (float, expected_reward)
        expected = {name: values[0].item() for name, values in simulation.info().items()}
        assert list(info.items()) == list(expected.items())
        assert [type(value) for value in info.values()] == [type(value) for value in expected.values()]


LARGE = {"delay": 3, "noise": 30.0, "quantise": 65.0, "missing": 0.3}  # 100 as a multiple of 65 is 130


@pytest.mark.parametrize("kind", KINDS)
def test_what_an_imperfection_shows_is_within_the_space(kind):
    """Also at an end of the range. The bounds stay where true values are shown, earlier ones or not."""
    columns = [*OBSERVED[1:4], "latent_mu_g"]
    view = {"observe": columns, "imperfections": {kind: dict.fromkeys(columns, LARGE[kind])}}
    given = settings(view=view)
    low, high = np.array(frame_bounds(given))
    lane, tape = Lane(given), random_tape(1)
    lane.reset(lane.everyone, tape)
    far = False
    for t in range(120):
        raw = tape(lane.everyone, None, 0, 1, lane.draws)[0, :, 0]
        seen, _, _ = lane.move((1.0, 1.0, -1.0) if t < 60 else (-1.0, -1.0, 1.0), raw)
        assert ((low <= seen) & (seen <= high)).all()
        far |= ((seen < 0) | (seen > [100, 100, 100, 5])).any()
    assert far == np.isinf(low).all() == np.isinf(high).all()


def test_the_first_delta_reward_is_within_the_episode():
    """In a lane that begins anew among others, it is that from its first observation to its second."""
    simulations = [Simulation(settings(view={"reward": reward}), 3) for reward in ("delta", "classic")]
    (delta, tape), (classic, other) = ((each, random_tape(3)) for each in simulations)
    actions = np.random.default_rng(0).uniform(-1, 1, (20, 3, 3)).astype(np.float32)

    def cost():
        fatigue, consumption = delta.carry.observations[:, 0, 4:6].astype(np.float64).T
        return consumption + 3.0 * fatigue

    begun = {0: [0, 1, 2], 6: [1], 7: [1], 11: [0, 2]}
    for t, action in enumerate(actions):
        if t in begun:
            delta.reset(np.array(begun[t]), tape)
            classic.reset(np.array(begun[t]), other)
        moving = np.array([0, 2]) if t % 5 == 3 else np.arange(3)
        before = cost()
        found = delta.step(moving, action[moving], tape)
        np.testing.assert_array_equal(found, np.float32(before - cost())[moving])
        rewards = classic.step(moving, action[moving], other)
        np.testing.assert_allclose(found, rewards + before[moving], rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (lambda state: by_hand.side_by_side(state, state), "set_state: found a state of 2 lanes, expected a"),
        (lambda state: state.replace(mu_v=[9.0]), "set_state: state.mu_v: found [9.], expected numbers"),
        (lambda state: state.replace(drift_left=[3]), "set_state: found a state of a moving setpoint; make "),
    ],
)
def test_a_state_that_cannot_be_gone_on_from_is_one_line(fault, message):
    lane = Lane(settings(setpoint=70))
    state = fault(initial_state([70.0]))
    refused(f"^{re.escape(message)}", lane.set_state, state, lane.everyone, random_tape(1))
    moving = Lane(settings(setpoint="drifting"))
    with pytest.raises(
        UsageError, match="found a state of a constant setpoint; make the environment with setpoint=a"
    ):
        moving.set_state(initial_state([70.0]), moving.everyone, random_tape(1))
    moving.set_state(initial_state([70.0], drifting=True), moving.everyone, random_tape(1))  # 0 steps left


def test_a_lane_takes_the_integers_of_its_generator_in_order_however_the_others_take_theirs():
    lanes, chance = 5, np.random.default_rng(0)
    streams = Streams(lanes)
    for lane in range(lanes):
        streams.seed(lane, lane)
    taken = [[] for _ in range(lanes)]
    while min(map(len, taken)) <= 2 * AHEAD:
        which = np.flatnonzero(chance.random(lanes) < 0.6)
        steps, slots = int(chance.integers(1, 4)), int(chance.choice([1, 4, 8]))
        drawn = streams.draw(which, Purpose.DYNAMICS, 0, steps, slots)
        assert drawn.shape == (steps, slots, len(which))
        for lane, integers in zip(which, drawn.reshape(steps * slots, len(which)).T, strict=True):
            taken[lane] += integers.tolist()
    for lane, integers in enumerate(taken):
        expected = np.random.default_rng(lane).bit_generator.random_raw(len(integers))
        assert integers == expected.tolist()
