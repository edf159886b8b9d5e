"""Random numbers of different episodes have different addresses."""

from __future__ import annotations

import hashlib
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.objects import still

import ibdata
from ibdata._numerics import random

pytestmark = pytest.mark.portable

ZERO = np.zeros((1, 2, 3))
NOISY = {"imperfections": {"noise": {"obs_gain": 1.0, "latent_mu_v": 0.1}}, "observe": "markov"}


@pytest.fixture
def hashed(monkeypatch):
    """What is hashed to keys, in the order of the calls."""
    seen: list[bytes] = []

    def sha256(content):
        seen.append(content)
        return hashlib.sha256(content)

    monkeypatch.setattr(random, "hashlib", SimpleNamespace(sha256=sha256))
    return seen


def test_no_two_digests_are_equal(hashed, tmp_path):
    """All ways to make random numbers, of one cell with one seed."""
    plain = {"name": "x", "setpoints": [70], "policies": ["random"], "episodes": 2, "steps": 5}
    calls = {
        "data": lambda: ibdata.generate(plain, tmp_path / "x", workers=1),
        "evaluation": lambda: ibdata.evaluate({"kind": "random"}, setpoint=70, episodes=2, steps=5),
        "branches": lambda: ibdata.true_values(tmp_path / "x", [0, 2, 4], "random", episodes=2, steps=5),
        "measurements": lambda: ibdata.evaluate(still, setpoint=70, steps=5, view=NOISY),
        "rows": lambda: ibdata.rollouts(tmp_path / "x", ZERO, rows=np.array([0, 0, 4])),
        "settings": lambda: ibdata.rollouts({"setpoint": [20, 70]}, ZERO),
        "other noise": lambda: ibdata.rollouts({"setpoint": [20, 70]}, ZERO, noise=1),
    }
    made = {}
    for name, call in calls.items():
        hashed.clear()
        call()
        made[name] = set(hashed)
    # Data are simulated again where rows are asked for; what a policy sees is played in evaluated episodes.
    for name, again in (("branches", "data"), ("rows", "data"), ("measurements", "evaluation")):
        made[name] -= made[again]
    counts = [len(keys) for keys in made.values()]
    assert len(set.union(*made.values())) == sum(counts)
    assert counts[2:] == [6, 2, 3, 4, 4]  # two for each branched row; others of data are the run's self-check
