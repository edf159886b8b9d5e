"""Means, standard errors and intervals."""

from __future__ import annotations

import numpy as np
import pytest

from ibdata.numerics.confidence import estimate, t_quantile

# Two-sided 95 % points of Student's t, from printed tables.
TABLE = {1: 12.706, 2: 4.303, 3: 3.182, 4: 2.776, 5: 2.571, 10: 2.228, 30: 2.042, 60: 2.000, 120: 1.980}


@pytest.mark.parametrize(("freedom", "printed"), TABLE.items())
def test_the_quantile_is_that_of_the_printed_tables(freedom, printed):
    assert round(t_quantile(freedom), 3) == printed


@pytest.mark.parametrize("freedom", [1e4, 1e6, 1e9])
def test_with_many_degrees_of_freedom_it_is_the_normal_one(freedom):
    assert t_quantile(freedom) == pytest.approx(1.959963985 + 2.3723 / freedom, abs=1e-6)


def test_groups_count_the_same_whatever_their_size():
    # Means 1 and 4: 2.5. Variances of the means 1/3 (of 0, 1, 2: variance 1) and 0.5 (of 3 and 5: 2 / 2).
    found = estimate([np.array([0.0, 1.0, 2.0]), np.array([3.0, 5.0])])
    assert found.mean == 2.5
    assert found.standard_error == pytest.approx(np.sqrt(1 / 3 + 1.0) / 2)


def test_degrees_of_freedom_are_welch_and_satterthwaites():
    """Of groups alike they are those of all together, of one that varies alone they are its own."""
    alike = np.array([1.0, 2.0, 4.0])
    found = estimate([alike, alike, alike])
    assert found.interval[1] - found.mean == pytest.approx(t_quantile(6) * found.standard_error)
    found = estimate([alike, np.ones(3)])
    assert found.interval[1] - found.mean == pytest.approx(t_quantile(2) * found.standard_error)


def test_equal_values_have_no_error_one_value_an_unknown_one():
    assert estimate([np.full(5, 0.1)]) == (0.1, 0.0, (0.1, 0.1))
    assert estimate([np.array([3.0])]) == (3.0, None, None)
    assert estimate([np.array([3.0]), np.array([1.0, 2.0])])[1:] == (None, None)


def test_the_interval_covers_the_mean_as_often_as_it_says():
    """4000 samples of 4 normals: 0.95 ± 5 standard errors; with the normal's 1.96 it would be 0.855."""
    values = np.random.default_rng(1).standard_normal((4000, 4))
    inside = [low <= 0.0 <= high for low, high in (estimate([row]).interval for row in values)]
    assert np.mean(inside) == pytest.approx(0.95, abs=5 * np.sqrt(0.95 * 0.05 / 4000))
