"""The script of the baselines: its rows are d3rlpy's transitions, its runs repeat, and it goes on after a kill."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from d3rlpy.dataset import InfiniteBuffer, ReplayBuffer

import ibdata

ROOT = Path(__file__).parents[3]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests")]

from helpers import script  # noqa: E402
from training import offline  # noqa: E402

SMALL = ["episodes=3", "steps=200"]


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> ibdata.Dataset:
    folder = tmp_path_factory.mktemp("baselines") / "small"
    return ibdata.generate("siemens-offline/optimized-40", folder, workers=1, overrides=SMALL)


@pytest.fixture(scope="module")
def rows(small) -> offline.Rows:
    return offline.rows_of(small)


def test_the_rows_are_the_transitions_that_d3rlpy_reads_from_the_export(small, rows, tmp_path):
    ibdata.export(small, "d3rlpy", tmp_path / "x.h5", history=30, reward_scale=0.01)
    with (tmp_path / "x.h5").open("rb") as file:
        replay = ReplayBuffer.load(file, InfiniteBuffer())
    theirs = [replay.transition_picker(e, i) for e in replay.episodes for i in range(e.transition_count)]
    ours = rows.batch(rows.transitions)
    assert len(theirs) == len(ours) == 600
    for name in ("observation", "action", "reward", "next_observation", "next_action"):
        expected = np.stack([getattr(transition, name) for transition in theirs])
        found = getattr(ours, f"{name}s")
        assert found.dtype == np.float32
        assert np.array_equal(found, expected), name
    assert [t.terminal for t in theirs] == ours.terminals[:, 0].tolist()
    assert [t.interval for t in theirs] == ours.intervals[:, 0].tolist()


def test_observations_are_standardised_as_d3rlpy_does_it(small, rows, tmp_path):
    ibdata.export(small, "d3rlpy", tmp_path / "x.h5", history=30, reward_scale=0.01)
    with (tmp_path / "x.h5").open("rb") as file:
        replay = ReplayBuffer.load(file, InfiniteBuffer())
    scaler = offline.StandardObservationScaler()
    scaler.fit_with_transition_picker(replay.episodes, replay.transition_picker)
    mean, std = rows.moments()
    np.testing.assert_allclose(mean, scaler.mean, rtol=1e-6)
    np.testing.assert_allclose(std, scaler.std, rtol=1e-4, atol=1e-5)
