"""Evaluation: returns and their random numbers, and what policies are given."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest
from helpers import by_hand
from helpers.evaluating import NUDGE, returns

from ibdata import evaluate
from ibdata._numerics.random import Purpose
from ibdata.dynamics import SIEMENS, initial_state
from ibdata.evaluation.play import _digests
from ibdata.experiment import Experiment

pytestmark = pytest.mark.portable

# The forms whose SHA-256 the addresses begin with; like the cells' they must never change.
ENVIRONMENT = (
    '{"dynamics": "siemens", "label": "evaluate", "setpoint": "0x1.1800000000000p+6", "start": "default"}'
)
POLICY = (
    '{"dynamics": "siemens", "label": "evaluate", "policy": {"kind": "random"}, '
    '"setpoint": "0x1.1800000000000p+6", "start": "default"}'
)
ADDRESSES = {ENVIRONMENT: "de83d400", POLICY: "ad3c2f08"}


def digest(form):
    return hashlib.sha256(form.encode()).digest()


def replayed(index, discount, actions):
    """The return of an episode at setpoint 70 and seed 3, by steps with noise of the documented addresses."""
    state, total = initial_state(70.0), 0.0
    for t, action in enumerate([(0.0, 0.0, 0.0), *actions]):
        state = by_hand.moved(state, action, by_hand.noise(3, digest(ENVIRONMENT), index, t), SIEMENS)
        total += discount ** (t - 1) * float(state.reward[0]) if t > 0 else 0.0
    return total


def test_a_policys_own_draws_come_from_the_address_with_its_form():
    def actions(index):
        u = [by_hand.uniforms_at(3, digest(POLICY), index, Purpose.POLICY, t, 4)[:3] for t in range(30)]
        return 2.0 * np.array(u) - 1.0

    expected = [replayed(index, 0.97, actions(index)) for index in range(4)]
    assert returns("random", discount=0.97, seed=3)[0] == pytest.approx(expected, rel=1e-13)


def test_the_random_numbers_have_their_addresses_for_ever():
    [cell] = Experiment(name="x", setpoints=70, policies=[{"kind": "random"}]).cells
    assert tuple(d.hex()[:8] for d in _digests(cell)) == tuple(ADDRESSES.values())
    assert {form: digest(form).hex()[:8] for form in ADDRESSES} == ADDRESSES


@pytest.mark.parametrize("start", ["default", "uniform", {"burn_in": [2, 9]}])
def test_all_policies_meet_the_same_environment(start):
    """A base that always acts is the base, although its wrapper draws from an address of its own."""
    always = {"kind": "epsilon_greedy", "base": NUDGE, "epsilon": 0.0}
    found = evaluate([NUDGE, always, {"kind": "bad"}], start=start, steps=30, episodes=4)
    np.testing.assert_array_equal(found.returns[0], found.returns[1])
    assert (found.returns[0] != found.returns[2]).all()


def test_nothing_but_the_address_matters(small_blocks):
    """More episodes, steps, setpoints, policies, and more lanes than a block holds."""
    few = returns("random", [10.0, 70.0])
    np.testing.assert_array_equal(returns("random", [70.0])[0], few[1])
    np.testing.assert_array_equal(returns("random", [70.0], episodes=300)[0, :4], few[1])
    np.testing.assert_array_equal(
        evaluate(["safe", "random"], 10.0, steps=30, episodes=4).returns[1], few[:1]
    )
    assert (returns("random", seed=1) != few[1]).all()
    small_blocks(lane_steps=7)
    np.testing.assert_array_equal(returns("random", [10.0, 70.0]), few)
