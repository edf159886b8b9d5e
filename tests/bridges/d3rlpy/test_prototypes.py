"""The runs on the paper's prototypes: what is learned from, one after the other, and without the setpoint."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from helpers import script

import ibdata
from training import model_based, offline
from training.plan import Run

SMALL = {"setpoints": [50, 75], "steps": 60, "episodes": 10}
SPLITS = {"train": {"episodes": "first 80%"}, "test": {"episodes": "last 20%"}}


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> ibdata.Dataset:
    folder = tmp_path_factory.mktemp("prototypes") / "small"
    return ibdata.generate("transfer", folder, workers=1, overrides={**SMALL, "splits": SPLITS})


@pytest.fixture
def prototypes(small, monkeypatch):
    """The script with a small dataset and short trainings."""
    found = script("prototypes")
    monkeypatch.setattr(found, "dataset_of", lambda name, data: small)
    monkeypatch.setattr(offline.train, "__defaults__", (6, *offline.train.__defaults__[1:]))
    for name in ("MODEL_STEPS", "CLONING_STEPS"):
        monkeypatch.setattr(model_based, name, 6)
    monkeypatch.setattr(model_based, "POLICY_STEPS", 2)
    return found


def test_a_part_has_the_first_episodes_at_each_setpoint(small, prototypes):
    frame = small.to_pandas()
    rows = prototypes.rows_of("transfer", "3 at 50 + 2 at 75", None)
    expected = frame[frame["episode"].isin([0, 1, 2, 10, 11])]
    actions = rows.actions[rows.transitions]
    assert np.array_equal(actions, expected[["act_velocity", "act_gain", "act_shift"]])
    assert np.array_equal(rows.observations[rows.transitions, 4], expected["obs_fatigue"])
    assert np.array_equal(rows.observations[rows.transitions + 1, 4], expected["next_obs_fatigue"])
    each = prototypes.rows_of("transfer", "2 episodes each", None)
    assert np.array_equal(each.observations[each.transitions][:, 0], np.repeat([50.0, 75.0], 120))


@pytest.mark.parametrize("algorithm", ["bc", "iql", "model-based"])
def test_a_run_goes_on_from_what_it_learned_first(prototypes, algorithm):
    def run(part):
        prototypes.rows_of.cache_clear()
        prototypes.trained_before.cache_clear()
        return prototypes.learned(Run("transfer", part, algorithm, 1), None)

    both, again = run("4 at 50, then 2 at 75"), run("4 at 50, then 2 at 75")
    assert both.evaluations == again.evaluations
    assert [e.setpoint for e in both.evaluations] == [75.0]
    others = [run("2 at 75"), run("4 at 50"), run("5 at 50, then 2 at 75")]
    assert all(other.evaluations[0].returns != both.evaluations[0].returns for other in others)
    if algorithm == "model-based":
        assert [(e.setpoint, e.steps) for e in both.model_errors] == [(75.0, 1), (75.0, 10)]
        assert all(e.consumption > e.floor_consumption > 1.0 for e in both.model_errors)
    else:
        assert both.model_errors is None
        assert both.training_steps == 6 // offline.FINE_TUNING


@pytest.mark.parametrize("algorithm", ["iql", "model-based"])
def test_a_blind_policy_does_not_see_the_setpoint(small, prototypes, algorithm):
    rows = prototypes.rows_of("transfer", "4 at 50 + 4 at 75", None)
    seen = rows.observations[:20].copy()
    other = seen.copy()
    other[:, ::6] = 100.0
    for blind in (True, False):
        if algorithm == "iql":
            policy, _ = offline.train("iql", rows, 0, blind=blind)
            actions = [policy.predict(x) for x in (seen, other)]
        else:
            learned, _ = model_based.train(rows, 0, blind=blind)
            actions = [learned.policy(torch.from_numpy(x)).numpy() for x in (seen, other)]
        assert np.array_equal(*actions) == blind


def test_what_is_constant_in_the_data_is_not_seen():
    spread = offline.seen_spread(np.array([0.0, 1e-6, 2.0]))
    assert spread.tolist() == [offline.UNSEEN, offline.UNSEEN, 2.0]
    assert np.float32(1.0) + np.float32(100.0 / offline.UNSEEN) == 1.0
