"""Means, standard errors and intervals."""

from __future__ import annotations

import numpy as np
import pytest

from ibdata._numerics.confidence import estimate, t_quantile

# Two-sided 95 % points of Student's t, from printed tables.
TABLE = {1: 12.706, 2: 4.303, 3: 3.182, 4: 2.776, 5: 2.571, 10: 2.228, 30: 2.042, 60: 2.000, 120: 1.980}


@pytest.mark.parametrize(("freedom", "printed"), TABLE.items())
def test_the_quantile_is_that_of_the_printed_tables(freedom, printed):
    assert round(t_quantile(freedom), 3) == printed


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
