"""The 27 discrete actions, without Gymnasium."""

from __future__ import annotations

import numpy as np
import pytest

from ibdata.environment.actions import DISCRETE, discrete_action, discrete_actions
from ibdata.environment.settings import settings
from ibdata.errors import UsageError


def test_the_last_of_velocity_gain_and_shift_changes_fastest():
    digits = [tuple(float(x) - 1 for x in np.base_repr(i, 3).zfill(3)) for i in range(27)]
    assert list(DISCRETE) == digits
    assert [discrete_action(i) for i in range(27)] == digits


@pytest.mark.parametrize("kind", [int, np.int64, np.uint8, np.array], ids=str)
def test_a_number_may_be_python_s_or_numpy_s(kind):
    assert discrete_action(kind(5)) == (-1.0, 0.0, 1.0)


@pytest.mark.parametrize(
    "given", [27, -1, 1.0, True, None, "3", [3], np.array([3]), np.float32(3), (0, 0, 0)]
)
def test_what_is_no_discrete_action_is_refused_in_one_line(given):
    with pytest.raises(UsageError, match=r"^action: found .*, expected a whole number from 0 to 26$"):
        discrete_action(given)


@pytest.mark.parametrize("kind", [list, np.array, lambda x: np.array(x, dtype=np.uint8)])
def test_those_of_many_lanes_are_those_of_one(kind):
    found = discrete_actions(kind([0, 26, 5]), 3)
    assert (found.dtype, found.shape) == (np.float32, (3, 3))
    assert found.tolist() == [list(discrete_action(i)) for i in (0, 26, 5)]


@pytest.mark.parametrize(
    "given",
    [[0, 1], [[0], [1], [2]], [0, 1, 27], [0, -1, 2], [0.0, 1.0, 2.0], [[0], 1, 2], 3, None, [True] * 3],
)
def test_what_are_no_discrete_actions_is_refused_in_one_line(given):
    with pytest.raises(UsageError) as caught:
        discrete_actions(given, 3)
    found = str(caught.value)
    assert found.startswith("action: found ")
    assert found.endswith(", expected 3 whole numbers from 0 to 26")
    assert "\n" not in found


def test_the_setting_is_true_or_false():
    assert settings(discrete_actions=np.True_).discrete_actions is True
    with pytest.raises(UsageError, match="discrete_actions: found 1, expected True or False"):
        settings(discrete_actions=1)
