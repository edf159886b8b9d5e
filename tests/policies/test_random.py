"""The random policy."""

from __future__ import annotations

import mpmath
import numpy as np
from helpers.asking import log_density_of, proposed

from ibdata.policies import POLICIES
from ibdata.policies.random import LOG_EIGHTH as LOG_DENSITY

Random = POLICIES["random"]
SMALLEST, LARGEST = 2.0**-53, 1.0 - 2.0**-53


def anywhere(n):
    return np.random.default_rng(0).uniform(0.0, 100.0, (n, 1, 6)).astype(np.float32)


def test_each_draw_is_one_action_scaled_to_minus_1_to_1():
    # 2 · 0.25 - 1 = -0.5; 2 · 0.5 - 1 = 0; 2 · 0.875 - 1 = 0.75
    np.testing.assert_array_equal(
        proposed(Random(), anywhere(2), np.array([[0.25, 0.5, 0.875], [0.5, 0.75, 0.0625]])),
        [[-0.5, 0.0, 0.75], [0.0, 0.5, -0.875]],
    )


def test_the_extreme_draws_stay_inside():
    action = np.asarray(proposed(Random(), anywhere(2), np.array([[SMALLEST] * 3, [LARGEST] * 3])))
    np.testing.assert_array_equal(action, [[-1.0 + 2.0**-52] * 3, [1.0 - 2.0**-52] * 3])


def test_evenly_spaced_draws_give_evenly_spaced_actions():
    u = np.tile((np.arange(1000.0)[:, None] + 0.5) / 1000.0, (1, 3))
    action = np.asarray(proposed(Random(), anywhere(1000), u))
    counts = [np.histogram(action[:, j], bins=10, range=(-1.0, 1.0))[0].tolist() for j in range(3)]
    assert counts == [[100] * 10] * 3


def test_the_log_density_is_log_one_eighth_rounded_to_a_double():
    with mpmath.workprec(200):
        assert float(mpmath.log(mpmath.mpf(1) / 8)) == LOG_DENSITY


def test_the_log_density_is_the_same_everywhere_inside():
    action = np.random.default_rng(2).uniform(-0.999, 0.999, (100, 3)).astype(np.float32)
    assert log_density_of(Random(), anywhere(100), action).tolist() == [LOG_DENSITY] * 100
