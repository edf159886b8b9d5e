"""The constant policy."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.asking import log_density_of, proposed
from pydantic import ValidationError

from ibdata.policies import POLICIES

Constant = POLICIES["constant"]
NO_DRAWS = np.empty((3, 0))
ANYWHERE = np.arange(18, dtype=np.float32).reshape(3, 1, 6)


def test_the_default_does_nothing():
    np.testing.assert_array_equal(proposed(Constant(), ANYWHERE, NO_DRAWS), np.zeros((3, 3)))


def test_every_lane_gets_the_action_in_the_order_velocity_gain_shift():
    action = proposed(Constant(action=(0.5, -1.0, 0.125)), ANYWHERE, NO_DRAWS)
    np.testing.assert_array_equal(action, [[0.5, -1.0, 0.125]] * 3)


def test_the_whole_mass_lies_at_its_own_action_rounded_to_float32():
    """0.1 and its float32 differ; a dataset holds the float32."""
    policy = Constant(action=(0.1, -1.0, 0.0))
    own = np.array([0.1, -1.0, 0.0], dtype=np.float32)
    others = np.tile(own, (3, 1))
    others[range(3), range(3)] = np.nextafter(own, np.float32(2.0))
    assert log_density_of(policy, ANYWHERE[:1], own[None]).tolist() == [0.0]
    assert log_density_of(policy, ANYWHERE, others).tolist() == [-np.inf] * 3


def test_a_stored_zero_has_the_mass_of_a_minus_zero_in_the_config():
    policy = Constant(action=(-0.0, 0.0, 0.0))
    assert log_density_of(policy, ANYWHERE, np.zeros((3, 3), dtype=np.float32)).tolist() == [0.0] * 3


@pytest.mark.parametrize(
    "action",
    [(0.0, 0.0), (0.0,) * 4, (0.0, 0.0, 1.0000001), (-1.1, 0.0, 0.0), (0.0, float("nan"), 0.0), (True, 0, 0)],
    ids=str,
)
def test_anything_but_three_numbers_from_minus_1_to_1_is_refused(action):
    with pytest.raises(ValidationError, match="action"):
        Constant(action=action)


def test_two_spellings_of_zero_are_one_policy():
    """They give the same data, so they must have the same random numbers."""
    assert Constant(action=(0.5, -0.0, 0.0)).form() == Constant(action=(0.5, 0.0, 0.0)).form()
    minus, plus = (repr(Constant(action=(0.5, x, 0.0)).form()) for x in (-0.0, 0.0))
    assert minus == plus
