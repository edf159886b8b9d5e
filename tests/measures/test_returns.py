"""Trajectory quality and return improvement, worked by hand."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

from ibdata.dataset.reference_returns import scale
from ibdata.measures import return_improvement, return_measures


def table(*rows):
    """Episodes of (setpoint, length, return)."""
    columns = dict(zip(("setpoint", "length", "return"), zip(*rows, strict=True), strict=True))
    return pa.table({name: np.array(column, dtype=np.float64) for name, column in columns.items()})


@pytest.fixture
def info(dataset):
    return dataset.stored.info


def test_return_improvement_does_not_depend_on_unit_or_zero():
    returns = np.array([0.0, 100.0, 200.0, 400.0])  # mean 175: (400 - 175) / 175
    assert return_improvement(returns) == pytest.approx(225 / 175)
    assert return_improvement(3.0 * returns - 1000.0) == pytest.approx(225 / 175)
    assert return_improvement(np.array([-5.0, -5.0])) is None


def test_setpoints_are_weighted_by_episodes(info):
    known = scale("siemens", "default", 1000, 1.0)
    (low20, high20), (low70, high70) = (known.ends([p], "expert") for p in (20.0, 70.0))
    half = 0.5 * (high70 - low70)
    found = return_measures(table((20, 1000, low20), (20, 1000, low20), (70, 1000, low70 + half)), info)
    assert found.trajectory_quality == pytest.approx(half / (2 * (high20 - low20) + high70 - low70))
    assert found.return_improvement is None
    rows = [(20, 1000, 0), (20, 1000, 4), (20, 1000, 1), (70, 1000, 0), (70, 1000, 1)]
    by_hand = (3 * (4 - 5 / 3) / (5 / 3) + 2 * (1 - 0.5) / 0.5) / 5
    assert return_measures(table(*rows), info).return_improvement == pytest.approx(by_hand)


def test_without_references_there_is_no_trajectory_quality(info):
    assert return_measures(table((70, 1000, -2e5)), info).trajectory_quality is not None
    assert return_measures(table((70, 1000, -2e5), (69, 1000, -2e5)), info).trajectory_quality is None
    assert return_measures(table((70, 1000, -2e5), (70, 40, -2e5)), info).trajectory_quality is None
    moving = info.model_copy(update={"drifting": True})
    assert return_measures(table((75, 1000, -2e5)), moving).trajectory_quality is None
    assert return_measures(table((75, 1000, -2e5)), info).trajectory_quality is not None


def test_returns_under_different_dynamics_are_not_compared(info):
    rows = table((70, 1000, -2e5), (70, 1000, -3e5))
    assert None not in return_measures(rows, info)
    assert return_measures(rows, info.model_copy(update={"dynamics": None})) == (None, None)
