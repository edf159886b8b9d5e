"""Off-policy evaluation and selection: the noise of the target policies, and the estimators."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from helpers import script

import ibdata
from training import estimators, offline
from training.selection import ESTIMATORS, Checkpoint

SMALL = ["episodes=20", "steps=100"]


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> ibdata.Dataset:
    folder = tmp_path_factory.mktemp("selection") / "small"
    return ibdata.generate("siemens-offline/global-100", folder, workers=1, overrides=SMALL)


@pytest.fixture(scope="module")
def rows(small) -> offline.Rows:
    return offline.rows_of(small)


@pytest.fixture(scope="module")
def policies(rows, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("policies")
    wanted = [Checkpoint("siemens-offline/global-100", "td3+bc", steps) for steps in (2, 5)]
    estimators.write_checkpoints(wanted, rows, folder)
    return folder / "policies"


@pytest.fixture(scope="module")
def target(policies) -> estimators.Target:
    return estimators.Target(policies / "siemens-offline-global-100-td3+bc-5.safetensors")


def test_a_checkpoint_is_what_the_baseline_has_learned_so_far(rows, policies, tmp_path):
    for steps in (2, 5):
        learned, _ = offline.train("td3+bc", rows, estimators.SEED, steps)
        said = f"td3+bc on siemens-offline/global-100, seed 0, {steps} of 15000 steps"
        ibdata.save_network(tmp_path / "x", learned, history=offline.HISTORY, provenance=said)
        assert (policies / f"siemens-offline-global-100-td3+bc-{steps}.safetensors").read_bytes() == (
            tmp_path / "x"
        ).read_bytes()


@pytest.mark.parametrize("mean", [-1.0, -0.2, 0.95])
def test_draws_have_the_density_of_the_target(mean):
    """The share of the draws below some points is the integral of the density up to them."""
    n = 20_001
    u = torch.linspace(1.0 / n, 1.0 - 1.0 / n, n, dtype=torch.float64)[:, None].expand(-1, 3)
    actions = estimators.drawn(torch.full((n, 3), mean, dtype=torch.float64), u).numpy()
    assert np.abs(actions).max() < 1.0
    assert np.array_equal(actions[:, 0], np.sort(actions[:, 0]))
    grid = np.linspace(-1.0, 1.0, 4001)
    middle = torch.from_numpy((grid[1:] + grid[:-1]) / 2.0)[:, None].expand(-1, 3)
    density = np.exp(estimators.log_density(torch.full_like(middle, mean), middle).numpy() / 3.0)
    below = np.cumsum(density) * np.diff(grid)
    assert below[-1] == pytest.approx(1.0, abs=1e-4)
    shares = np.searchsorted(actions[:, 0], grid[1:]) / n
    np.testing.assert_allclose(shares, below, atol=2e-3)


def test_fqe_counts_as_many_rewards_as_it_has_fits(rows, target, monkeypatch):
    """The reward falls by far more than 3 from the start of an episode to its end."""
    monkeypatch.setattr(estimators, "FIT_STEPS", 300)
    reward = ibdata.evaluate(target, setpoint=70, steps=1, episodes=200).results[0].mean_return
    rest = float(rows.rewards[rows.transitions].mean()) / offline.REWARD_SCALE
    found = estimators.by_fqe(rows, target, fits=1)
    assert abs(found - reward) < 0.2 * abs(rest - reward)
    assert estimators.by_fqe(rows, target, fits=1) == found
    two = ibdata.evaluate(target, setpoint=70, steps=2, episodes=200).results[0].mean_return
    assert estimators.by_fqe(rows, target, fits=2) == pytest.approx(two, rel=0.05)


class Pushing:
    """Raises the velocity by 1 a step."""

    def mean(self, history):
        return torch.tensor([[1.0, 0.0, 0.0]]).repeat(len(history), 1)


def test_a_rollout_in_the_model_adds_up_discounted_rewards(rows, monkeypatch):
    monkeypatch.setattr(estimators, "drawn", lambda mean, u: mean)

    def fatigue_is_velocity(x):
        assert x.shape[1] == 6 * estimators.FRAMES + 4
        np.testing.assert_array_equal(x[:, -3], np.minimum(x[:, 1] + 1.0, 100.0))
        return np.stack([x[:, -3], np.full(len(x), 2.0)], axis=1)

    t = np.arange(100)
    expected = np.sum(0.97**t * (-2.0 - 3.0 * np.minimum(51.0 + t, 100.0)))
    assert estimators.by_model(rows, Pushing(), fatigue_is_velocity) == pytest.approx(expected)


def test_the_script_trains_what_is_missing(small, tmp_path, monkeypatch):
    selection, one = script("selection"), Checkpoint("siemens-offline/global-100", "bc", 4)
    other = one._replace(training_steps=2)
    monkeypatch.setattr(selection, "plan", lambda: [other, one, one._replace(algorithm="iql")])
    monkeypatch.setattr(selection.runner, "dataset", lambda name, data, steps=None: small)
    monkeypatch.setattr(selection, "EPISODES", 100)
    monkeypatch.setattr(estimators, "by_fqe", partial(estimators.by_fqe, fits=1))
    monkeypatch.setattr(estimators, "EXAMPLES", 2000)
    other.file(tmp_path).parent.mkdir()
    other.file(tmp_path).write_bytes(b"kept")
    line, target = selection.make(one, tmp_path), estimators.Target(one.file(tmp_path))
    assert other.file(tmp_path).read_bytes() == b"kept"
    assert sorted(path.name for path in other.file(tmp_path).parent.iterdir()) == [
        "siemens-offline-global-100-bc-2.safetensors",
        "siemens-offline-global-100-bc-4.safetensors",
    ]
    assert (line.key, line.sha256, line.content_root) == (one, target.sha256, small.content_root)
    truth = ibdata.evaluate(target, setpoint=70, episodes=100).results[0]
    assert (line.value.mean_return, line.value.interval) == (truth.mean_return, truth.interval)
    importance = estimators.by_importance(small, target)
    weighted, per_decision, _ = importance.results
    assert line.estimates["weighted"].mean_return == weighted.mean_return
    assert line.estimates["per decision"].interval == per_decision.interval
    assert line.effective["3"] == importance.effective[2]
    assert list(line.estimates) == list(ESTIMATORS)
    assert line.estimates["FQE"].mean_return == estimators.by_fqe(offline.rows_of(small), target)
    assert list(line.cpu_seconds) == ["true value", "importance sampling", "FQE", "model"]
