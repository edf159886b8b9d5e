"""Actions of one lane and of many: three numbers, or one of 27, without Gymnasium."""

from __future__ import annotations

import numpy as np
import pytest

from ibdata.environment.actions import (
    DISCRETE,
    continuous_action,
    continuous_actions,
    discrete_action,
    discrete_actions,
)
from ibdata.environment.settings import settings
from ibdata.errors import UsageError


def test_the_last_of_velocity_gain_and_shift_changes_fastest():
    digits = [tuple(float(x) - 1 for x in np.base_repr(i, 3).zfill(3)) for i in range(27)]
    assert list(DISCRETE) == digits
    for kind in (int, np.uint8, np.array):  # a number of Python's or numpy's
        assert [discrete_action(kind(i)) for i in range(27)] == digits


@pytest.mark.parametrize("kind", [list, np.array, lambda x: np.array(x, dtype=np.uint8)])
def test_discrete_actions_of_many_lanes_are_those_of_one(kind):
    found = discrete_actions(kind([0, 26, 5]), 3)
    assert (found.dtype, found.shape) == (np.float32, (3, 3))
    assert found.tolist() == [list(discrete_action(i)) for i in (0, 26, 5)]


@pytest.mark.parametrize("given", [[0.1, -7, 2], (0, 0, 0), np.array([1e300] * 3), np.ones(3, "f4")[::-1]])
def test_actions_are_clipped_and_rounded_alike(given):
    expected = np.clip(np.array(given, dtype=np.float64), -1.0, 1.0).astype(np.float32).tolist()
    assert {type(x) for x in continuous_action(given)} == {float}
    assert continuous_actions([given, continuous_action(given)], 2).tolist() == [expected, expected]


REFUSED = [
    (discrete_action, "a whole number from 0 to 26",
     [27, -1, 1.0, True, None, "3", [3], np.array([3]), np.float32(3), (0, 0, 0)]),
    (lambda given: discrete_actions(given, 3), "3 whole numbers from 0 to 26",
     [[0, 1], [[0], [1], [2]], [0, 1, 27], [0, -1, 2], [0.0, 1.0, 2.0], [[0], 1, 2], 3, None, [True] * 3]),
    (continuous_action, "three finite numbers",
     [[0, 0, np.nan], np.array([0, np.inf, -np.inf]), [0, 0], "left", None]),
    (lambda given: continuous_actions(given, 1), "(1, 3) finite numbers",
     [[[0, 0, np.nan]], [[0, 0]], [0, 0, 0], "left", [[None, 0, 0]]]),
]  # fmt: skip


@pytest.mark.parametrize(("convert", "expected", "wrong"), REFUSED, ids=[row[1] for row in REFUSED])
def test_other_actions_are_refused_in_one_line(convert, expected, wrong):
    for given in wrong:
        with pytest.raises(UsageError) as caught:
            convert(given)
        assert str(caught.value).startswith("action: found ")
        assert f", expected {expected}" in str(caught.value)
        assert "\n" not in str(caught.value)


def test_the_setting_of_discrete_actions_is_true_or_false():
    assert settings(discrete_actions=np.True_).discrete_actions is True
    with pytest.raises(UsageError, match="discrete_actions: found 1, expected True or False"):
        settings(discrete_actions=1)
