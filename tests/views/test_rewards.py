"""Rewards from consumption and fatigue."""

from __future__ import annotations

import numpy as np
import pytest

from ibdata.errors import UsageError
from ibdata.views.rewards import reward_of

BEFORE = np.array([100.1, 3.0], np.float32), np.array([10.7, 0.5], np.float32)  # consumption, fatigue
AFTER = np.array([90.3, 4.0], np.float32), np.array([12.9, 0.25], np.float32)


@pytest.mark.parametrize("scale", [1.0, 0.01])
def test_weights_are_computed_in_float64_and_rounded_once(scale):
    assert reward_of({"fatigue": 2}).of(BEFORE, AFTER, 1.0).tolist() == (-2 * AFTER[1]).tolist()
    found = reward_of({"consumption": 0.7, "fatigue": 2.2}).of(BEFORE, AFTER, scale)
    exact = [-(0.7 * float(c) + 2.2 * float(f)) * scale for c, f in zip(*AFTER, strict=True)]
    assert found.tolist() == np.array(exact).astype(np.float32).tolist()
    assert found.dtype == np.float32


def test_delta_is_the_difference_of_two_classic_rewards():
    weights = reward_of({"consumption": 1, "fatigue": 3})
    difference = weights.cost(*BEFORE) - weights.cost(*AFTER)
    assert reward_of("delta").of(BEFORE, AFTER, 1.0).tolist() == difference.astype(np.float32).tolist()


def test_rewards_that_become_infinite_are_refused():
    with pytest.raises(
        UsageError, match=r"reward: found weights or a scale .1e.300. that make rewards infinite"
    ):
        reward_of("delta").of(BEFORE, AFTER, 1e300)
    with np.errstate(all="ignore"), pytest.raises(UsageError, match="that make rewards infinite"):
        reward_of({"consumption": 1e308, "fatigue": -1e308}).of(BEFORE, AFTER, 1.0)  # inf - inf
