"""The baselines: their rows are d3rlpy's transitions, and their runs repeat."""

import numpy as np
import pytest
import torch
from d3rlpy.dataset import InfiniteBuffer, ReplayBuffer
from helpers import script

import ibdata
from ibdata.evaluation.baselines import WHOLE
from training import model_based, offline
from training.plan import Run, episodes_each

SMALL = ["episodes=3", "steps=200"]


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> ibdata.Dataset:
    folder = tmp_path_factory.mktemp("baselines") / "small"
    return ibdata.generate("siemens-offline/optimized-40", folder, workers=1, overrides=SMALL)


@pytest.fixture(scope="module")
def rows(small) -> offline.Rows:
    return offline.rows_of(small)


def test_rows_and_their_moments_are_those_of_d3rlpy(small, rows, tmp_path):
    ibdata.export(small, "d3rlpy", tmp_path / "x.h5", history=30, view={"reward_scale": 0.01})
    with (tmp_path / "x.h5").open("rb") as file:
        replay = ReplayBuffer.load(file, InfiniteBuffer())
    theirs = [replay.transition_picker(e, i) for e in replay.episodes for i in range(e.transition_count)]
    ours = rows.batch(rows.transitions)
    assert len(theirs) == len(ours) == 600
    for name in ("observation", "action", "reward", "next_observation", "next_action"):
        found = getattr(ours, f"{name}s")
        assert found.dtype == np.float32
        assert np.array_equal(found, [getattr(transition, name) for transition in theirs]), name
    assert [t.terminal for t in theirs] == ours.terminals[:, 0].tolist()
    assert [t.interval for t in theirs] == ours.intervals[:, 0].tolist()
    scaler = offline.StandardObservationScaler()
    scaler.fit_with_transition_picker(replay.episodes, replay.transition_picker)
    mean, std = rows.moments()
    np.testing.assert_allclose(mean, scaler.mean, rtol=1e-6)
    np.testing.assert_allclose(std, scaler.std, rtol=1e-4, atol=1e-5)


@pytest.fixture
def baselines(small, monkeypatch):
    found = script("baselines")
    monkeypatch.setattr(found.runner, "dataset", lambda name, data: small)
    return found


def test_a_result_is_what_evaluate_measures_of_the_policy(small, rows, baselines):
    line = baselines.learned(baselines.Run("siemens-offline/optimized-40", WHOLE, "bc", 1), None, steps=20)
    policy, _ = offline.train("bc", rows, seed=1, steps=20)
    found = ibdata.evaluate(policy, 70, history=30, episodes=200)
    [kept] = line.evaluations
    assert kept.values.tolist() == found.returns[0].astype(np.float32).tolist()
    assert (kept.mean_return, kept.standard_error, kept.p10) == pytest.approx(
        (found.results[0].mean_return, found.results[0].standard_error, found.results[0].p10), rel=1e-4
    )
    assert line.content_root == small.content_root


def test_agents_are_kept_as_they_act_and_never_replaced(rows, tmp_path, monkeypatch):
    prototypes, shipped = script("prototypes"), tmp_path / "shipped"
    shipped.mkdir()
    monkeypatch.setattr(prototypes, "SHIPPED", shipped)
    mean, std = (torch.from_numpy(x).float() for x in rows.moments())
    torch.manual_seed(0)
    policies = {
        "td3+bc": offline.train("td3+bc", rows, seed=1, steps=20)[0],
        "model-based": model_based.Policy(mean, model_based.spread_of(std)),
    }
    for algorithm, policy in policies.items():
        run = Run("random", episodes_each(10), algorithm, 1)
        block = prototypes.saved(policy, run, tmp_path)
        file = shipped / f"random-{algorithm.replace('+', '')}-1.safetensors"
        assert block["file"] == str(file)
        found, expected = (
            ibdata.evaluate(x, episodes=3, steps=40, history=history).returns
            for x, history in ((block, 1), (policy, 30))
        )
        np.testing.assert_allclose(found, expected, rtol=1e-4)
        before = file.read_bytes()
        again = prototypes.saved(policies["td3+bc"], run, tmp_path)
        assert again["file"] == str(tmp_path / file.name)
        assert file.read_bytes() == before
    assert [Run("random", episodes_each(n), "bc", 0).agent for n in (1, 10)] == [None, "random-bc-0"]
