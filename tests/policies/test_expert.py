"""The expert: it computes the direction that it cannot see, and nothing simple is better."""

from __future__ import annotations

import numpy as np
import pytest

import ibdata
from ibdata.policies.expert import TABLES, UNKNOWN, Expert, best_shift, interpolated
from ibdata.policies.given import Given

SIEMENS = np.array(TABLES["siemens"])


def made(tmp_path, **options):
    block = {"name": "expert", "setpoints": [0, 52, 75, 100], "policies": [{"kind": "expert"}], "steps": 60}
    return ibdata.generate(
        ibdata.Experiment(**{**block, **options}), tmp_path / "made", workers=1
    ).to_pandas()


@pytest.mark.parametrize("start", ["default", "uniform"])
def test_it_turns_the_direction_from_0_to_6_and_back_again_and_again(tmp_path, start):
    rows = made(tmp_path, start=start, steps=100)
    for _, episode in rows.groupby(["episode", "obs_setpoint"]):
        far = np.abs(episode["latent_direction"].to_numpy()[-36:])
        assert far.max() == 6
        assert (np.abs(np.diff(far)) <= 1).all()
        assert np.array_equal(far[12:], far[:-12])  # it takes 12 steps


def test_what_it_remembers_is_the_hidden_state(tmp_path):
    rows = made(tmp_path, setpoints="drifting")
    policy, memory = Expert(), np.zeros((1, 4))
    columns = [f"obs_{name}" for name in ("setpoint", "velocity", "gain", "shift", "fatigue", "consumption")]
    seen = rows[columns].to_numpy(np.float32)
    hidden = rows[["latent_domain", "latent_response", "latent_direction"]].to_numpy()
    nothing = np.zeros((1, 0))
    for t in range(len(seen)):
        last = seen[[t, max(t - 1, 0)]][None]
        given = Given(last, np.zeros((1, 2, 3), np.float32), np.array([t]), nothing, nothing, memory)
        memory = np.asarray(policy.decide(given).memory)
        assert memory[0, :3].tolist() == hidden[t].tolist()


def test_after_a_burn_in_it_stays_in_the_safe_zone_until_the_direction_is_known(tmp_path):
    rows = made(tmp_path, start={"burn_in": [5, 30]}, episodes=5)
    for _, episode in rows.groupby(["obs_setpoint", "episode"]):
        turned = np.flatnonzero(episode["latent_direction"] == 0)
        assert turned[0] <= 12 + UNKNOWN  # 12 steps at most from the farthest shift to the zone
        far = np.abs(episode["latent_direction"].to_numpy()[-24:])
        assert np.array_equal(far[12:], far[:-12])


@pytest.mark.parametrize(
    ("p", "expected"),
    [(0.0, 40.0), (2.5, 40.0), (22.5, 39.5), (51.999999, 30.5), (52.0, 41.0), (100.0, 32.0)],
)
def test_velocities_are_interpolated_between_the_rows_of_the_table(p, expected):
    assert interpolated(SIEMENS, p, 1) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("dynamics", TABLES)
def test_the_tables_have_every_setpoint_in_order(dynamics):
    p, v, g = np.array(TABLES[dynamics]).T
    assert (p[0], p[-1]) == (0.0, 100.0)
    assert (np.diff(p) >= 0.0).all()
    assert ((v >= 0.0) & (v <= 100.0) & (g >= 0.0) & (g <= 100.0)).all()


def test_a_direction_on_the_wrong_side_is_turned_back_in_the_safe_zone():
    assert best_shift(1.0, -1, 1, 3) == 0.125
    assert best_shift(-1.0, -1, 1, -3) < -0.8


@pytest.mark.parametrize("dynamics", TABLES)
def test_it_is_better_than_optimized_at_every_setpoint(dynamics):
    policies = [{"kind": "expert", "dynamics": dynamics}, "optimized"]
    points = [0.0, 70.0, 100.0]
    made = ibdata.evaluate(policies, points, dynamics=dynamics, steps=1000, discount=1.0, episodes=8)
    for difference in made.differences:
        assert -difference.mean_difference > 5 * difference.standard_error


def test_its_reward_at_70_is_that_of_its_constants_and_the_best_penalty():
    """Of the constants, -163.1 (scripts/expert); of the penalty, 25 · (1 - 0.718) = 7.05, found by search."""
    (result,) = ibdata.evaluate("expert", 70, steps=1000, discount=1.0, episodes=20).results
    assert result.mean_reward == pytest.approx(-170.5, abs=0.5)
