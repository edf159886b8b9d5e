"""The stochasticity of actions, worked by hand."""

from __future__ import annotations

import numpy as np
import pytest

from ibdata.measures.stochasticity import LEAST_ROWS, Stochasticity, action_entropy


def test_it_is_the_mean_over_rows_of_the_standard_deviation_in_the_cell():
    """Cell 3: half ±1 in velocity only. Cell 8: twice as many rows, and no spread."""
    found = Stochasticity()
    moving = np.zeros((10, 3))
    moving[:, 0] = [1, -1] * 5
    found.add(np.full(10, 3), moving)
    found.add(np.full(20, 8), np.full((20, 3), 0.25))
    in_cell_3 = np.sqrt(10 / 9) / 3  # of velocity, gain and shift: √(10/9), 0, 0
    assert found.value == pytest.approx(in_cell_3 * 10 / 30)


def test_cells_with_few_rows_do_not_count():
    found = Stochasticity()
    found.add(np.full(LEAST_ROWS - 1, 5), np.ones((LEAST_ROWS - 1, 3)))
    assert found.value is None


def test_entropy_is_the_mean_of_minus_the_log_density():
    """Half of the actions are the deterministic policy's, with mass ½; the others have density ½ · 1/8."""
    log_prob = np.log(np.array([0.5, 0.5, 1 / 16, 1 / 16], dtype=np.float32))
    assert action_entropy(log_prob) == pytest.approx((np.log(2) + np.log(16)) / 2, rel=1e-6)
    assert action_entropy(np.zeros(3)) == 0.0
    assert np.isnan(action_entropy(np.array([0.0, np.nan])))
