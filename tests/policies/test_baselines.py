"""Policies of one formula, compared with numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.policies import action_of, proposed

from ibdata.policies import POLICIES
from ibdata.policies.baselines import OBSERVATION_MEAN

Random = POLICIES["random"]
Bad, Mediocre, Optimized = (POLICIES[kind] for kind in ("bad", "mediocre", "optimized"))
SMALLEST, LARGEST = 2.0**-53, 1.0 - 2.0**-53
SOME = np.arange(18, dtype=np.float32).reshape(3, 1, 6)


def now(v, g, h):
    """One episode in which everything but velocity, gain and shift would mislead."""
    return np.array([[[70.0, v, g, h, 30.0, 200.0]]], dtype=np.float32)


@pytest.mark.parametrize(
    ("policy", "seen", "expected"),
    [  # the way to 100 or 25 in raw units, taken in doubles; what is above 1 is clipped later
        (Bad(), (50.0, 99.5, 100.0), [50.0, 0.5, 0.0]),
        (Mediocre(), (25.0, 24.75, 27.0), [0.0, 0.25, -2.0]),
        (Mediocre(), (np.float32(24.9),) * 3, [25.0 - float(np.float32(24.9))] * 3),
    ],
    ids=["bad", "mediocre", "in doubles"],
)
def test_steering_is_the_way_to_the_target(policy, seen, expected):
    assert proposed(policy, now(*seen)).tolist() == [expected]
    assert action_of(policy, now(*seen)).tolist() == np.clip([expected], -1.0, 1.0).astype("f4").tolist()


def optimized(**values):
    """The action at the mean of every column, but for values such as h3=78.67."""
    history = np.tile(np.array(OBSERVATION_MEAN), (1, 6, 1))
    for name, value in values.items():
        history[0, int(name[1]), "pvghfc".index(name[0])] = value
    return proposed(Optimized(), history.astype(np.float32))[0]


@pytest.mark.parametrize(
    ("values", "component", "expected"),
    [
        ({}, 0, -0.91),  # all z are 0
        ({}, 1, 1.43),
        ({}, 2, 0.81),
        ({"v5": 36.44}, 0, 0.09),  # z = (36.44 - 48.75) / 12.31 = -1, 1 - 0.91
        ({"f3": 21.925}, 1, 0.43),  # z = -½, -1 + 1.43
        ({"p0": 83.72}, 1, 0.43),  # z = 1, -1 + 1.43
        ({"h3": 52.372}, 2, 0.462),  # z = 0.1, -0.348 + 0.81
        ({"h4": 64.06}, 2, 0.31),  # z = 0.5, -0.5 + 0.81
        ({"p0": 40.64}, 2, -0.19),  # z = -0.5, -1 + 0.81
    ],
)
def test_optimized_is_its_formula(values, component, expected):
    assert optimized(**values)[component] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("u", "expected"),
    [(0.25, -0.5), (0.5, 0.0), (0.875, 0.75), (SMALLEST, -1.0 + 2.0**-52), (LARGEST, 1.0 - 2.0**-52)],
)
def test_random_scales_each_draw_to_minus_1_to_1(u, expected):
    for j in range(3):
        draws = np.full((1, 3), 0.5)
        draws[0, j] = u
        assert proposed(Random(), SOME[:1], draws)[0, j] == expected
