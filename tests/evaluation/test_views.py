"""What users' objects see of new episodes, and the rewards that count."""

from __future__ import annotations

import numpy as np
import pytest

import ibdata
from ibdata.errors import UsageError

ALIKE = {"setpoint": 20, "steps": 12, "episodes": 3, "seed": 4}
TROUBLES = {"delay": {"obs_fatigue": 2}, "missing": {"obs_velocity": 0.3}, "noise": {"obs_gain": 1.0}}


class Watcher:
    """Remembers what it was given at each step, and always acts in the same way."""

    def __init__(self):
        self.seen = {}

    def decide(self, given):
        self.seen[int(given.step[0])] = given.observations.copy()  # the last time it is asked
        return np.tile([[0.5, -0.25, 0.125]], (len(given.step), 1)), given.memory


def watched(**given):
    """What an object saw (steps, episodes, frames, numbers of a frame), and the evaluation."""
    watcher = Watcher()
    found = ibdata.evaluate(watcher, **ALIKE, **given)
    return np.stack([watcher.seen[step] for step in range(ALIKE["steps"])]), found


def test_an_object_sees_the_whole_state_and_its_actions():
    plain, _ = watched()
    now, _ = watched(view={"observe": "markov", "actions": True}, history=2)
    assert now.shape == (12, 3, 2, 23)
    assert (now[:, :, 0, :6] == plain[:, :, 0]).all()
    assert (now[1:, :, 1] == now[:-1, :, 0]).all()
    assert (now[0, :, 1] == now[0, :, 0]).all()
    assert (now[1:, :, 0, 7:15] == now[:-1, :, 0, 6:14]).all()  # θ is a shift register
    assert (now[1:, :, 0, 20:] == np.float32([0.5, -0.25, 0.125])).all()
    assert (now[0, :, 0, 20:] == 0).all()


def test_imperfections_change_what_is_seen_and_not_what_happens():
    plain, clean = watched()
    seen, found = watched(view={"imperfections": TROUBLES})
    now, true = seen[:, :, 0], plain[:, :, 0]
    assert (now[2:, :, 4] == true[:-2, :, 4]).all()
    assert not (now[:, :, 2] == true[:, :, 2]).any()
    assert (now[:, :, [0, 3, 5]] == true[:, :, [0, 3, 5]]).all()
    assert found.returns.tolist() == clean.returns.tolist()


def test_rewards_are_weighted_as_in_a_dataset():
    """Each reward is that of the frame after the action; the last frame is not seen."""
    frames, _ = watched()
    shorter = {**ALIKE, "steps": 11, "discount": 1.0}
    found = ibdata.evaluate(Watcher(), **shorter, view={"reward": {"consumption": 0.5, "fatigue": 2}})
    costs = frames[1:, :, 0].astype(float)
    rewards = -(0.5 * costs[:, :, 5] + 2 * costs[:, :, 4]).astype(np.float32)
    assert found.returns[0, 0] == pytest.approx(rewards.sum(axis=0, dtype=float), rel=1e-12)
    assert found.results[0].score is None
    assert found.notes == ["no score: optimized is made for the classic reward"]
    change = ibdata.evaluate(Watcher(), **shorter, view={"reward": "delta"}).returns[0, 0]
    cost = frames[[0, -1], :, 0, 5].astype(float) + 3.0 * frames[[0, -1], :, 0, 4]
    assert change == pytest.approx(cost[0] - cost[1], abs=1e-4)


def test_a_view_that_nobody_could_see_is_refused():
    with pytest.raises(UsageError, match="view: found one, but no object that could see it"):
        ibdata.evaluate("safe", **ALIKE, view={"observe": "markov"})


def test_policies_of_ibdata_see_what_they_need_beside_an_object_with_a_view():
    both = ibdata.evaluate([Watcher(), "optimized"], **ALIKE, view={"observe": ["obs_gain"]})
    assert both.returns[1].tolist() == ibdata.evaluate("optimized", **ALIKE).returns[0].tolist()
