"""Coverage, stochasticity and the measures of returns by hand, and `ibdata.quality` of datasets."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest
from helpers.refusals import refused

import ibdata
from ibdata.dataset.quality import (
    PAIRS,
    STATES,
    Coverage,
    Stochasticity,
    action_entropy,
    pair_numbers,
    return_improvement,
    return_measures,
    state_numbers,
    steered,
)
from ibdata.dataset.reference_returns import scale
from ibdata.dynamics import Noise, initial_state, step
from ibdata.errors import UsageError

ONE = np.array([1])


def test_each_interval_has_its_number():
    """Setpoints in 5, velocity, gain and shift in 10; 100 belongs to the last interval; actions in five."""
    rows = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 9.9], [0.0, 0.0, 10.0], [0.0, 100.0, 0.0], [25.0, 0.0, 0.0]])
    assert state_numbers(np.zeros(5), rows).tolist() == [0, 0, 1, 90, 200]
    assert state_numbers([4.9, 5.0, 100.0], np.zeros((3, 3))).tolist() == [0, 1000, 20_000]
    assert state_numbers([100.0], [[100.0, 100.0, 100.0]]) == STATES - 1
    actions = np.array([[-1.0, -1.0, -1.0], [-1.0, -1.0, -0.59], [-1.0, 0.0, -1.0], [0.3, -1.0, -1.0]])
    assert pair_numbers(np.zeros(4, dtype=np.int64), actions).tolist() == [0, 1, 2 * 5, 3 * 25]
    assert pair_numbers(np.array([STATES - 1]), [[1.0, 1.0, 1.0]]) == PAIRS - 1


def test_steering_is_that_of_the_dynamics():
    rng = np.random.default_rng(0)
    lengths = np.array([30, 7])
    actions, start = rng.uniform(-1, 1, (37, 3)), np.array([[99.0, 3.0, 50.0], [0.5, 95.0, 99.0]])
    found = steered(start, actions, lengths)
    for own, begun in ((slice(0, 30), start[0]), (slice(30, 37), start[1])):
        state = initial_state(70.0, *begun)
        for row, action in zip(found[own], actions[own], strict=True):
            np.testing.assert_allclose(row, [state.velocity[0], state.gain[0], state.shift[0]], rtol=1e-15)
            state = step(state, action[None], Noise(*np.zeros((len(Noise._fields), 1))))


def test_a_pair_of_state_and_action_counts_once():
    found = Coverage()
    state, still = np.full((1, 3), 50.0), np.zeros((1, 3))
    found.add(np.array([70.0]), state, still, ONE)
    found.add(np.array([71.0]), state + 1.0, still, ONE)
    assert found.pairs[0] == 1
    found.add(np.array([75.0]), state, still, ONE)
    found.add(np.array([70.0]), state, still + 0.5, ONE)
    assert found.pairs[0] == 3
    assert found.pairs[1] > 3


def test_it_is_the_mean_standard_deviation_of_the_cells():
    """Cell 3: half ±1 in velocity only. Cell 8: twice as many rows, and no spread."""
    found = Stochasticity()
    moving = np.zeros((10, 3))
    moving[:, 0] = [1, -1] * 5
    found.add(np.full(10, 3), moving)
    found.add(np.full(20, 8), np.full((20, 3), 0.25))
    in_cell_3 = np.sqrt(10 / 9) / 3  # of velocity, gain and shift: √(10/9), 0, 0
    assert found.value == pytest.approx(in_cell_3 * 10 / 30)


def test_entropy_is_the_mean_of_minus_the_log_density():
    """Half of the actions are the deterministic policy's, with mass ½; the others have density ½ · 1/8."""
    log_prob = np.log(np.array([0.5, 0.5, 1 / 16, 1 / 16], dtype=np.float32))
    assert action_entropy(log_prob) == pytest.approx((np.log(2) + np.log(16)) / 2, rel=1e-6)
    assert action_entropy(np.zeros(3)) == 0.0
    assert np.isnan(action_entropy(np.array([0.0, np.nan])))


@pytest.fixture(scope="module")
def explored(describe, tmp_path_factory):
    """Random, half random and deterministic actions, 8 episodes of each."""
    base = {"kind": "mediocre"}
    policies = [
        {"kind": "random"},
        {"kind": "epsilon_greedy", "base": base, "epsilon": 0.5, "name": "half"},
        {**base, "name": "none"},
    ]
    options = {"setpoints": [70], "policies": policies, "episodes": 8, "steps": 250}
    experiment = describe(**options, output={"shard_rows": 1000})
    return ibdata.generate(experiment, tmp_path_factory.mktemp("quality") / "made", workers=1)


def test_random_actions_have_coverage_1_and_full_entropy_and_others_less(explored):
    random, half, none = (ibdata.quality(explored.select(policy=name)) for name in ("random", "half", "none"))
    assert random.state_action_coverage == pytest.approx(1.0, abs=0.05)
    assert random.action_entropy == pytest.approx(3 * np.log(2), rel=1e-6)
    assert random.action_stochasticity == pytest.approx(1 / np.sqrt(3), abs=0.02)  # of U(-1, 1)
    assert (random.rows, random.episodes) == (2000, 8)
    assert random.state_action_coverage > half.state_action_coverage > none.state_action_coverage
    assert none.state_action_coverage < 0.1
    assert none.action_entropy == 0.0
    # half: mass ½ on the policy's action, else density 1/16
    assert half.action_entropy == pytest.approx(0.5 * np.log(2) + 0.5 * np.log(16), abs=0.1)


def test_the_pairs_are_those_of_all_rows_whatever_the_batches(explored, small_blocks):
    frame = explored.to_pandas()
    states = state_numbers(frame["obs_setpoint"], frame[["obs_velocity", "obs_gain", "obs_shift"]])
    numbers = pair_numbers(states, frame[["act_velocity", "act_gain", "act_shift"]])
    whole = ibdata.quality(explored)
    assert whole.pairs == len(np.unique(numbers))
    small_blocks(counted_rows=333)
    parts = ibdata.quality(explored)
    assert parts.plain() == pytest.approx(whole.plain())


def test_splits_and_selections_are_those_of_the_reader(dataset):
    found = ibdata.quality(dataset.select("source", setpoint=20, policy="calm"))
    assert (found.rows, found.episodes) == (120, 3)
    with pytest.raises(UsageError, match="no episode that meets all"):
        ibdata.quality(dataset.select("source", setpoint=70))
    refused("expected one of source, target", ibdata.quality, dataset, "nope")


def table(*rows):
    """Episodes of (setpoint, length, return)."""
    columns = dict(zip(("setpoint", "length", "return"), zip(*rows, strict=True), strict=True))
    return pa.table({name: np.array(column, dtype=np.float64) for name, column in columns.items()})


@pytest.fixture
def info(dataset):
    return dataset.stored.info


def test_setpoints_are_weighted_by_episodes(info):
    known = scale("siemens", "default", 1000, 1.0)
    (low20, high20), (low70, high70) = (known.ends([p], "expert") for p in (20.0, 70.0))
    half = 0.5 * (high70 - low70)
    found = return_measures(table((20, 1000, low20), (20, 1000, low20), (70, 1000, low70 + half)), info)
    assert found.trajectory_quality == pytest.approx(half / (2 * (high20 - low20) + high70 - low70))
    assert found.return_improvement is None
    returns = np.array([0.0, 100.0, 200.0, 400.0])  # mean 175: (400 - 175) / 175
    assert return_improvement(3.0 * returns - 1000.0) == pytest.approx(225 / 175)
    rows = [(20, 1000, 0), (20, 1000, 4), (20, 1000, 1), (70, 1000, 0), (70, 1000, 1)]
    by_hand = (3 * (4 - 5 / 3) / (5 / 3) + 2 * (1 - 0.5) / 0.5) / 5
    assert return_measures(table(*rows), info).return_improvement == pytest.approx(by_hand)


def test_without_references_there_is_no_trajectory_quality(info):
    assert return_measures(table((70, 1000, -2e5)), info).trajectory_quality is not None
    assert return_measures(table((70, 1000, -2e5), (69, 1000, -2e5)), info).trajectory_quality is None
    assert return_measures(table((70, 1000, -2e5), (70, 40, -2e5)), info).trajectory_quality is None
    moving = info.model_copy(update={"drifting": True})
    assert return_measures(table((75, 1000, -2e5)), moving).trajectory_quality is None
    rows = table((70, 1000, -2e5), (70, 1000, -3e5))
    assert None not in return_measures(rows, info)
