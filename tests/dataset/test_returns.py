"""How good the behaviour of a dataset was, and on which scale."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

import ibdata as library
from ibdata.reference import scale


def test_returns_are_by_policy_and_setpoint(dataset):
    found = dataset.returns()
    frame = dataset.episodes
    assert [(r["policy"], r["setpoint"]) for r in found["results"]] == [
        (policy, p) for policy in ("random", "calm") for p in (20.0, 70.0)
    ]
    for r in found["results"]:
        rows = frame[(frame["policy"] == r["policy"]) & (frame["setpoint"] == r["setpoint"])]["return"]
        assert r["episodes"] == len(rows) == 3
        assert r["mean_return"] == pytest.approx(rows.mean())
        assert r["standard_error"] == pytest.approx(rows.std() / np.sqrt(3))
        assert r["mean_reward"] == pytest.approx(rows.mean() / 40)
        assert r["score"] is None
    assert found["scale"] is None


@pytest.fixture(scope="module")
def whole(describe, tmp_path_factory):
    """Episodes of 1000 steps, for which there is a scale."""
    changes = {"setpoints": [69, 70], "steps": 1000, "policies": [{"kind": "optimized"}]}
    return library.generate(describe(**changes), tmp_path_factory.mktemp("whole") / "made", workers=1)


def test_whole_episodes_from_the_default_start_have_a_score(whole):
    found = whole.returns()
    assert [r["score"] is None for r in found["results"]] == [True, False]  # no reference at 69
    assert found["results"][1]["score"] == pytest.approx(100.0, abs=3.0)
    made = scale("siemens", "default", 1000, 1.0)
    assert found["results"][1]["score"] == made.score(70.0, found["results"][1]["mean_return"])
    assert found["scale"] == made.text


@pytest.mark.parametrize(
    "changes",
    [{"start": "uniform"}, {"setpoints": {"drifting": 70}}, {"dynamics": {"base": "siemens"}}],
    ids=str,
)
def test_other_episodes_have_none(describe, tmp_path, changes):
    experiment = describe(**{"setpoints": [70], "steps": 1000, "episodes": 1, **changes})
    found = library.generate(experiment, tmp_path / "made", workers=1).returns()
    assert [r["score"] for r in found["results"]] == [None, None]
    assert found["scale"] is None


def test_info_shows_them_and_imports_neither_simulator_nor_policies(whole, ibdata):
    text = ibdata("info", str(whole.path)).stdout
    assert "score: 0 = random, 100 = optimized" in text
    assert json.loads(ibdata("info", str(whole.path), "--json").stdout)["returns"]["scale"] in text
    code = (
        "import sys\nfrom ibdata.cli import main\ntry:\n    main(sys.argv[1:])\nexcept SystemExit:\n"
        "    print([m for m in ('numba', 'ibdata.dynamics', 'ibdata.policies') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, "info", str(whole.path)], capture_output=True, text=True
    )
    assert done.stdout.splitlines()[-1] == "[]"
