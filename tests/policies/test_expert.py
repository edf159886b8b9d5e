"""The expert: it computes what it cannot see, keeps μᵛ from running away, and is better than `optimized`."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import ROOT, script

import ibdata
from ibdata.dynamics import VARIANTS
from ibdata.dynamics.fatigue import basic_fatigue, effective_gain, effective_velocity, fatigue
from ibdata.dynamics.miscalibration import RHO_S
from ibdata.policies import Observed
from ibdata.policies.expert import (
    AIM,
    ALARM,
    GAINS,
    LEAVING,
    TURNING,
    UNKNOWN,
    Expert,
    best_gain,
    best_shift,
    interpolated,
    numbers,
    resetting_velocity,
    velocity_and_gain,
)

TABLE, RULE = numbers("siemens")
K = VARIANTS["siemens"].parameters
STARTS = ["default", "uniform", {"burn_in": [15, 64]}]


def made(tmp_path, **options):
    block = {"name": "expert", "setpoints": [0, 53, 75, 100], "policies": [{"kind": "expert"}], "steps": 60}
    return ibdata.generate(
        ibdata.Experiment(**{**block, **options}), tmp_path / "made", workers=1
    ).to_pandas()


@pytest.mark.parametrize("start", ["default", "uniform"])
def test_it_turns_the_direction_from_0_to_6_and_back(tmp_path, start):
    rows = made(tmp_path, start=start, steps=100)
    for _, episode in rows.groupby(["episode", "obs_setpoint"]):
        far = np.abs(episode["latent_direction"].to_numpy()[-36:])
        assert far.max() == 6
        assert (np.abs(np.diff(far)) <= 1).all()
        assert np.array_equal(far[12:], far[:-12])  # it takes 12 steps


def test_the_first_turn_begins_at_once(tmp_path):
    rows = made(tmp_path, setpoints=[0, 30, 70, 100])
    for _, episode in rows.groupby("obs_setpoint"):
        far = np.abs(episode["latent_direction"].to_numpy()[:12])
        assert far.tolist() == [1, 2, 3, 4, 5, 6, 5, 4, 3, 2, 1, 0]


def test_what_it_remembers_is_the_hidden_state(tmp_path):
    rows = made(tmp_path, setpoints="drifting")
    policy, memory = Expert(), np.zeros((1, 6))
    columns = [f"obs_{name}" for name in ("setpoint", "velocity", "gain", "shift", "fatigue", "consumption")]
    seen = rows[columns].to_numpy(np.float32)
    hidden = rows[["latent_domain", "latent_response", "latent_direction"]].to_numpy()
    nothing = np.zeros((1, 0))
    for t in range(len(seen)):
        last = seen[[t, max(t - 1, 0)]][None]
        given = Observed(last, np.zeros((1, 2, 3), np.float32), np.array([t]), nothing, nothing, memory)
        memory = np.asarray(policy.decide(given).memory)
        assert memory[0, :3].tolist() == hidden[t].tolist()


def test_after_a_burn_in_it_waits_in_the_safe_zone(tmp_path):
    rows = made(tmp_path, start={"burn_in": [5, 30]}, episodes=5)
    for _, episode in rows.groupby(["obs_setpoint", "episode"]):
        turned = np.flatnonzero(episode["latent_direction"] == 0)
        assert turned[0] <= 12 + UNKNOWN  # 12 steps at most from the farthest shift to the zone
        far = np.abs(episode["latent_direction"].to_numpy()[-24:])
        assert np.array_equal(far[12:], far[:-12])


def test_a_direction_beyond_the_domain_is_followed_at_once():
    assert best_shift(1.0, 1, -1, -6) == -RHO_S[5]
    assert best_shift(-1.0, -1, 1, 1) == TURNING


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


def asked(v, g, alpha, mu=0.0, alarm=0, p=40.0, rule=RULE):
    f = fatigue(basic_fatigue(v, g), alpha)
    return velocity_and_gain(p, v, g, f, mu, alarm, TABLE, rule, K)


def test_where_mu_is_high_the_velocity_rises_and_the_gain_falls():
    calm, tense = (asked(31.0, 100.0, 0.1, mu) for mu in (0.2, 1.3))
    assert calm[:2] == (interpolated(TABLE, 40.0, AIM), best_gain(TABLE, 40.0, 31.0))
    assert tense[0] == pytest.approx(calm[0] + RULE.rise * (tense[2] - RULE.rise_from))
    assert tense[1] == pytest.approx(100.0 - RULE.fall * (tense[2] - RULE.fall_from))


RESET = resetting_velocity(40.0, K)


@pytest.mark.parametrize(
    ("p", "v", "g", "alpha", "before", "gain", "after"),
    [  # two high α raise the gain until that of the gain is reset
        (70.0, 38.0, 45.0, 0.9, 0, "table", 1),
        (70.0, 38.0, 45.0, 0.9, 1, 100.0, ALARM),
        (70.0, 38.0, 95.0, 0.3, ALARM, "table", 0),
        # a runaway of the velocity is left where gain 0 resets it
        (40.0, 31.0, 95.0, 0.9, ALARM, "table", LEAVING),
        (40.0, RESET - 3.0, 40.0, 0.9, LEAVING, 0.0, LEAVING),
        (40.0, RESET + 0.5, 0.0, 0.3, LEAVING, "table", 0),
    ],
)
def test_a_runaway_is_seen_and_left(p, v, g, alpha, before, gain, after):
    _, found, _, alarm = asked(v, g, alpha, alarm=before, p=p)
    assert found == pytest.approx(best_gain(TABLE, p, v) if gain == "table" else gain)
    assert alarm == after


def test_gain_0_resets_the_velocity():
    assert effective_gain(95.0, 40.0) < 0.05
    assert asked(31.0, 95.0, 0.9, alarm=ALARM)[0] == RESET + 0.5
    assert effective_velocity(RESET, 0.0, 40.0, K.v0, K.g0, K.v1, K.g1) == pytest.approx(0.05)


def test_where_the_table_leaves_no_fatigue_there_is_no_feedback():
    assert asked(38.0, 90.0, 0.9, mu=1.2, alarm=ALARM, p=10.0) == (40.0, 100.0, 0.0, 0)


@pytest.mark.parametrize("start", [{"burn_in": [15, 64]}, "uniform"])
def test_no_episode_ends_in_a_runaway(tmp_path, start):
    rows = made(
        tmp_path, setpoints=[40, 70, 100], start=start, episodes=30, steps=150, output={"latent": "full"}
    )
    last = rows[rows["step"] >= 140].groupby(["obs_setpoint", "episode"])["latent_alpha"].min()
    assert (last < RULE.runaway).mean() > 0.97


@pytest.mark.parametrize("dynamics", VARIANTS)
def test_the_tables_have_every_setpoint_in_order(dynamics):
    table, _ = numbers(dynamics)
    assert (table[0, 0], table[-1, 0]) == (0.0, 100.0)
    assert (np.diff(table[:, 0]) >= 0.0).all()
    assert (np.unique(table[:, 0], return_counts=True)[1] <= 2).all()
    assert set(np.arange(0.0, 101.0, 5.0)) <= set(table[:, 0])
    assert ((table >= 0.0) & (table <= 100.0)).all()
    assert table.shape[1] == GAINS + 21


def test_values_are_interpolated_and_jump_at_a_double_row():
    table = np.array([[0.0, 40.0], [50.0, 30.0], [50.0, 42.0], [100.0, 32.0]])
    found = [interpolated(table, p, 1) for p in (0.0, 25.0, 49.999999, 50.0, 75.0, 100.0)]
    assert found == pytest.approx([40.0, 35.0, 30.0, 42.0, 37.0, 32.0], abs=1e-5)


@pytest.mark.parametrize("dynamics", VARIANTS)
def test_the_gains_are_those_that_the_script_finds(dynamics):
    table, _ = numbers(dynamics)
    for row in table[[0, 7, -1]]:
        assert script("expert").best_gains(dynamics, row[0]) == row[GAINS:].tolist()


@pytest.mark.parametrize("start", STARTS, ids=str)
@pytest.mark.parametrize("dynamics", VARIANTS)
def test_it_is_better_than_optimized_at_every_setpoint_and_start(dynamics, start):
    policies = [{"kind": "expert", "dynamics": dynamics}, "optimized"]
    options = {"dynamics": dynamics, "start": start, "steps": 1000, "discount": 1.0, "episodes": 16}
    for difference in ibdata.evaluate(policies, np.arange(0.0, 101.0, 10.0), **options).differences:
        assert -difference.mean_difference > 5 * difference.standard_error


@pytest.mark.parametrize(
    ("start", "setpoints", "least"),
    [
        ("default", 70.0, -170.5),
        ({"burn_in": [15, 64]}, 70.0, -171.0),
        ("default", np.arange(10.0, 101.0, 10.0), -148.0),
    ],
    ids=str,
)
def test_its_reward_is_as_high_as_measured(start, setpoints, least):
    found = ibdata.evaluate("expert", setpoints, start=start, steps=1000, discount=1.0, episodes=40)
    assert np.mean([row.mean_reward for row in found.results if row.setpoint is not None]) > least


def test_it_is_better_than_every_shipped_network():
    files = [path.stem for path in (ROOT / "ibdata/policies/weights").glob("*.safetensors")]
    networks = [{"kind": "network", "file": name, "name": name} for name in files]
    found = ibdata.evaluate(["expert", *networks], 70, steps=1000, discount=1.0, episodes=2).results
    rewards = {row.policy: row.mean_reward for row in found}
    assert len(rewards) == 23
    assert max(rewards[name] for name in files) < -210.0 < rewards["expert"]
