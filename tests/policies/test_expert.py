"""The expert: it computes what it cannot see, keeps μᵛ from running away, and is better than `optimized`."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import FULL, script

import ibdata
from ibdata.dynamics import VARIANTS
from ibdata.policies import Observed
from ibdata.policies.expert import (
    GAINS,
    SPACING,
    UNKNOWN,
    Expert,
    best_gain,
    interpolated,
    numbers,
    velocity_and_gain,
)

TABLE, RULE = numbers("siemens")
K = VARIANTS["siemens"].parameters
SETPOINTS = np.arange(0.0, 101.0, 10.0) if FULL else [0.0, 52.5, 97.5]
STARTS = ["default", "uniform", {"burn_in": [15, 64]}]


def made(tmp_path, **options):
    block = {"name": "expert", "setpoints": [0, 53, 75, 100], "policies": [{"kind": "expert"}], "steps": 60}
    return ibdata.generate(
        ibdata.Experiment(**{**block, **options}), tmp_path / "made", workers=1
    ).to_pandas()


def test_what_it_remembers_is_the_hidden_state(tmp_path):
    rows = made(tmp_path, setpoints="drifting")
    policy, memory = Expert(), np.zeros((1, 6))
    columns = [f"obs_{name}" for name in ("setpoint", "velocity", "gain", "shift", "fatigue", "consumption")]
    seen = rows[columns].to_numpy(np.float32)
    hidden = rows[["latent_domain", "latent_response", "latent_direction"]].to_numpy()
    nothing, mu, alarm = np.zeros((1, 0)), 0.0, 0
    for t in range(len(seen)):
        last = seen[[t, max(t - 1, 0)]][None]
        given = Observed(last, np.zeros((1, 2, 3), np.float32), np.array([t]), nothing, nothing, memory)
        memory = np.asarray(policy.decide(given).memory)
        *_, mu, alarm = velocity_and_gain(*map(float, seen[t, [0, 1, 2, 4]]), mu, alarm, TABLE, RULE, K)
        assert memory[0, [0, 1, 2, 4, 5]].tolist() == [*hidden[t].tolist(), mu, alarm]


def test_between_its_rows_the_table_is_linear():
    for p in (0.0, 2.5, 12.3, 52.0, 97.5, 100.0):
        found = [interpolated(TABLE, p, column) for column in range(TABLE.shape[1])]
        assert found == pytest.approx([np.interp(p, TABLE[:, 0], column) for column in TABLE.T])


def test_after_a_burn_in_it_waits_in_the_safe_zone(tmp_path):
    rows = made(tmp_path, start={"burn_in": [5, 30]}, episodes=5)
    for _, episode in rows.groupby(["obs_setpoint", "episode"]):
        turned = np.flatnonzero(episode["latent_direction"] == 0)
        assert turned[0] <= 12 + UNKNOWN  # 12 steps at most from the farthest shift to the zone
        far = np.abs(episode["latent_direction"].to_numpy()[-24:])
        assert np.array_equal(far[12:], far[:-12])


def test_the_estimate_of_mu_follows_the_hidden_one(tmp_path):
    rows = made(tmp_path, setpoints=[30, 40], steps=500, output={"latent": "full"})
    errors = []
    for p, episode in rows.groupby("obs_setpoint"):
        mu, alarm = 0.0, 0
        for t, row in enumerate(episode.itertuples()):
            seen = (row.obs_velocity, row.obs_gain, row.obs_fatigue)
            *_, mu, alarm = velocity_and_gain(float(p), *seen, mu, alarm, TABLE, RULE, K)
            errors += [mu - row.latent_mu_v] if t > 50 and alarm == 0 and row.obs_gain > 90.0 else []
    assert len(errors) > 500
    assert abs(np.mean(errors)) < 0.1
    assert np.std(errors) < 0.1


@pytest.mark.parametrize("dynamics", VARIANTS)
def test_the_gains_are_those_that_the_script_finds(dynamics):
    table, _ = numbers(dynamics)
    for row in table[[0, 7, -1]]:
        assert script("expert").best_gains(dynamics, row[0]) == row[GAINS:].tolist()


def test_the_gain_is_interpolated_between_the_velocities_of_the_table():
    row = TABLE[3]
    for i, gain in enumerate(row[GAINS:]):
        assert best_gain(TABLE, row[0], SPACING * i) == pytest.approx(gain, abs=1e-12)
    middle = [best_gain(TABLE, row[0], SPACING * i + SPACING / 2) for i in range(len(row) - GAINS - 1)]
    assert middle == pytest.approx((row[GAINS:-1] + row[GAINS + 1 :]) / 2, abs=1e-12)


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("dynamics", VARIANTS)
def test_it_is_better_than_optimized_at_every_setpoint_and_start(dynamics, start):
    policies = [{"kind": "expert", "dynamics": dynamics}, "optimized"]
    options = {"dynamics": dynamics, "start": start, "steps": 1000, "discount": 1.0, "episodes": 4}
    for difference in ibdata.evaluate(policies, SETPOINTS, **options).differences:
        assert -difference.mean_difference > 5 * difference.standard_error
