"""True values: branches from exact states, their random numbers, means and errors."""

from __future__ import annotations

import hashlib
import json
import re
from typing import ClassVar, Literal

import numpy as np
import pytest
from helpers import by_hand
from helpers.refusals import refused

from ibdata import state_at, true_values
from ibdata._numerics.random import Purpose
from ibdata.policies import Decision, Needs, Policy

NUDGE = {"kind": "constant", "action": [0.5, -1, 0.25]}


class Recalling(Policy):
    """Does nothing, records what it is given, and counts its steps and sums past actions in its memory."""

    needs: ClassVar[Needs] = Needs(history=2, draws=1, episode_draws=1, memory=2)
    given: ClassVar[list] = []

    kind: Literal["recalling"] = "recalling"

    def decide(self, given):
        self.given.append(given.apply(np.copy))
        added = np.stack([np.ones(len(given.step)), given.actions[:, 0, 0]], axis=1)
        return Decision(np.zeros((len(given.step), 3)), given.memory + added)


def branches(ds, rows, policy, actions=None, **settings):
    return true_values(ds, rows, policy, actions, **{"steps": 12, "episodes": 5, **settings}).returns


def form(ds, episode, step, policy=None):
    """The form of which the key of a row's branches is made, as JSON; it must never change."""
    experiment = by_hand.experiment_of(ds)
    cell, index = divmod(episode, experiment.episodes)
    digest = experiment.cells[cell].digest.hex()
    plain = {"label": "branch", "cell": digest, "index": index, "seed": experiment.seed, "step": step}
    return json.dumps(plain if policy is None else {**plain, "policy": policy}, sort_keys=True)


def replayed(ds, episode, step, branch, actions, discount=0.97, seed=0):
    """The return of a branch, by single steps with the noise of the documented addresses."""
    experiment = by_hand.experiment_of(ds)
    digest = hashlib.sha256(form(ds, episode, step).encode()).digest()
    state, total = state_at(ds, (episode, step)), 0.0
    for t, action in enumerate(actions):
        noise = by_hand.noise(seed, digest, branch, t + 1, experiment.drifting)
        state = by_hand.moved(state, action, noise, experiment.scenario.variant)
        total += discount**t * float(state.reward[0])
    return total


@pytest.mark.parametrize("discount", [0.97, 0.0])
def test_a_branch_goes_on_with_noise_of_its_own(either, discount):
    """Also where setpoints move."""
    found = branches(either, {"episode": [4, 9], "step": [17, 0]}, NUDGE, discount=discount, seed=3)
    for i, (episode, step) in enumerate([(4, 17), (9, 0)]):
        expected = [replayed(either, episode, step, j, [NUDGE["action"]] * 12, discount, 3) for j in range(5)]
        assert found[i] == pytest.approx(expected, rel=1e-13)


def test_a_policys_own_draws_come_from_the_address_with_its_form(dataset):
    digest = hashlib.sha256(form(dataset, 4, 17, {"kind": "random"}).encode()).digest()

    def actions(branch):
        u = [by_hand.uniforms_at(0, digest, branch, Purpose.POLICY, t, 4)[:3] for t in range(12)]
        return 2.0 * np.array(u) - 1.0

    [found] = branches(dataset, [4 * 40 + 17], "random")
    assert found == pytest.approx([replayed(dataset, 4, 17, j, actions(j)) for j in range(5)], rel=1e-13)


def test_the_first_action_may_be_given(dataset):
    given = [[1.0, 0.0, -0.5], [0.0, 0.25, 3.0]]  # clipped to 1
    found = branches(dataset, np.array([0, 100]), NUDGE, given)
    for i, (episode, step, first) in enumerate([(0, 0, given[0]), (2, 20, [0.0, 0.25, 1.0])]):
        actions = [first, *[NUDGE["action"]] * 11]
        expected = [replayed(dataset, episode, step, j, actions) for j in range(5)]
        assert found[i] == pytest.approx(expected, rel=1e-13)


def test_a_policy_knows_what_it_would_have_seen(dataset, monkeypatch):
    monkeypatch.setattr(Recalling, "given", [])
    branches(dataset, np.array([40 * 5 + 20, 40 * 5 + 3]), Recalling(), [[1, 0, 0], [1, 0, 0]], episodes=2)
    moved = dataset.to_pandas()["act_velocity"].to_numpy()[200:]
    digest = by_hand.experiment_of(dataset).cells[1].digest
    [drawn] = by_hand.uniforms_at(0, digest, 2, Purpose.EPISODE_POLICY, 0, 4)[:1]
    first, second = Recalling.given[-12:-10]
    stored = dataset.arrays(history=2)["observations"].reshape(-1, 2, 6)
    np.testing.assert_array_equal(first.observations, stored[[220, 220, 203, 203]])
    np.testing.assert_array_equal(second.observations[:, 1], first.observations[:, 0])
    assert first.step.tolist() == [20, 20, 3, 3]
    assert second.step.tolist() == [21, 21, 4, 4]
    np.testing.assert_array_equal(first.actions[[0, 2], :, 0], [[moved[19], moved[18]], [moved[2], moved[1]]])
    np.testing.assert_array_equal(second.actions[[0, 2], :, 0], [[1, moved[19]], [1, moved[2]]])
    sums = [moved[:19].sum(dtype=float), moved[:2].sum(dtype=float)]
    np.testing.assert_allclose(first.memory[[0, 2]], [[20, sums[0]], [3, sums[1]]], rtol=1e-6)
    np.testing.assert_array_equal(second.memory[:, 0], first.memory[:, 0] + 1)
    assert (first.episode_draws == drawn).all()
    assert len(np.unique([first.draws, second.draws])) == 8


def test_values_are_means_with_their_errors(dataset):
    found = true_values(dataset, np.array([85, 410]), "random", steps=12, episodes=50)
    assert [(r.episode, r.step, r.action) for r in found.results] == [(2, 5, None), (10, 10, None)]
    np.testing.assert_allclose(found.values, found.returns.mean(axis=1), rtol=1e-14)
    np.testing.assert_allclose(
        found.standard_errors, found.returns.std(axis=1, ddof=1) / np.sqrt(50), rtol=1e-12
    )
    # Student's t with 49 degrees of freedom: 2.009575
    half = 2.009575 * found.standard_errors[0]
    value = found.values[0]
    assert found.results[0].interval == pytest.approx((value - half, value + half), rel=1e-6)
    assert found.to_pandas()["value"].tolist() == found.values.tolist()
    plain = json.loads(json.dumps(found.plain()))["results"][1]
    assert set(plain) == {"episode", "step", "action", "value", "standard_error", "interval"}
    with_action = true_values(dataset, [85], "random", [[0, 2, 0]], steps=2, episodes=1)
    assert with_action.results[0].action == [0.0, 1.0, 0.0]
    assert with_action.results[0].standard_error is None
    assert np.isnan(with_action.standard_errors).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"rows": [480]}, "row: found 480, expected one of 0 to 479"),
        ({"rows": {"episode": [0], "step": [40]}}, "step: found 40, expected one of 0 to 39, the steps of"),
        ({"rows": {"episode": [0]}}, "rows: found a table without 'step', expected columns episode, step"),
        ({"actions": [0, 0, 0]}, "actions: found [0, 0, 0], expected (2, 3) finite numbers"),
        ({"steps": 0}, "steps: found 0, expected a whole number of at least 1"),
        ({"episodes": 2**47}, "episodes: this number takes "),
        ({"policy": ["safe", "bad"]}, "expected one policy: a kind, a block, an object"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else value,
)
def test_what_cannot_be_meant_is_one_line(dataset, arguments, message):
    refused(re.escape(message), true_values, dataset, **{"rows": range(2), "policy": "random", **arguments})
