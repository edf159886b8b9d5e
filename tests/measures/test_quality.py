"""`ibdata.quality` of datasets and of parts of them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

import ibdata
import ibdata.measures as module
from ibdata.cli.read import stats_command as command
from ibdata.errors import UsageError
from ibdata.measures import pair_numbers, state_numbers


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


def test_random_actions_have_coverage_1_and_full_entropy(explored):
    found = ibdata.quality(explored, policy="random")
    assert found.state_action_coverage == pytest.approx(1.0, abs=0.05)
    assert found.action_entropy == pytest.approx(3 * np.log(2), rel=1e-6)
    assert found.action_stochasticity == pytest.approx(1 / np.sqrt(3), abs=0.02)  # of U(-1, 1)
    assert (found.rows, found.episodes) == (2000, 8)


def test_less_random_actions_cover_less(explored):
    random, half, none = (ibdata.quality(explored, policy=name) for name in ("random", "half", "none"))
    coverages = [found.state_action_coverage for found in (random, half, none)]
    assert coverages == sorted(coverages, reverse=True)
    assert none.state_action_coverage < 0.1
    assert none.action_entropy == 0.0
    # half: mass ½ on the policy's action, else density 1/16
    assert half.action_entropy == pytest.approx(0.5 * np.log(2) + 0.5 * np.log(16), abs=0.1)


def test_the_pairs_are_those_of_all_rows_whatever_the_batches(explored, monkeypatch):
    frame = explored.to_pandas()
    states = state_numbers(frame["obs_setpoint"], frame[["obs_velocity", "obs_gain", "obs_shift"]])
    numbers = pair_numbers(states, frame[["act_velocity", "act_gain", "act_shift"]])
    whole = ibdata.quality(explored)
    assert whole.pairs == len(np.unique(numbers))
    monkeypatch.setattr(module, "BATCH_ROWS", 333)
    parts = ibdata.quality(explored)
    assert parts.plain() == pytest.approx(whole.plain())


def test_splits_and_selections_are_those_of_the_reader(dataset):
    found = ibdata.quality(dataset, "source", setpoint=20, policy="calm")
    assert (found.rows, found.episodes) == (120, 3)
    with pytest.raises(UsageError, match="no episode that meets all"):
        ibdata.quality(dataset, "source", setpoint=70)
    with pytest.raises(UsageError, match="expected one of source, target"):
        ibdata.quality(dataset, "nope")


def test_what_is_not_known_has_no_value(describe, tmp_path):
    experiment = describe(policies=[lambda seen: seen[:, 1:4] / 100.0], setpoints={"drifting": [50]})
    found = ibdata.quality(ibdata.generate(experiment, tmp_path / "made", workers=1))
    assert found.action_entropy is found.trajectory_quality is None


def test_it_shows_and_converts(dataset):
    found = ibdata.quality(dataset)
    frame = found.to_pandas()
    assert list(frame["measure"]) == [name.replace("_", " ") for name in module.MEANING]
    assert frame["value"][2] == found.state_action_coverage
    assert "480 rows in 12 episodes" in repr(found)
    assert json.loads(json.dumps(found.plain()))["trajectory_quality"] is None


def test_stats_prints_it(dataset):
    text = CliRunner().invoke(command, [str(dataset.path), "--quality"], catch_exceptions=False).stdout
    assert text == f"{ibdata.quality(dataset)!r}\n"
    run = CliRunner().invoke(command, [str(dataset.path), "--quality", "--json"], catch_exceptions=False)
    assert json.loads(run.stdout)["quality"] == ibdata.quality(dataset).plain()
