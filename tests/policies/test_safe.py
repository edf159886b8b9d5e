"""The safe policy: towards the medium range from outside, uniform inside. `test_recount` counts its draws."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
import pytest
from helpers.policies import distribution, log_density_of, proposed

from ibdata.policies import POLICIES
from ibdata.policies import baselines as module
from ibdata.policies.base import at_start

Safe = POLICIES["safe"]
BELOW, INSIDE, ABOVE = 20.0, 50.0, 80.0
SD = 3**-0.5
Z_1 = NormalDist(0.5, SD).cdf(1.0)  # the draw that makes z = 1
TOWARDS, AWAY, HALF = module.LOG_MASS_TOWARDS, module.LOG_MASS_AWAY, module.LOG_HALF


def history(v, g):
    """One episode in which everything but velocity and gain would mislead."""
    return np.array([[[10.0, v, g, 90.0, 30.0, 70.0]]], dtype=np.float32)


@pytest.mark.parametrize(
    ("x", "expected"),
    [
        (0.0, 1.0),
        (np.nextafter(np.float32(40), np.float32(0)), 1.0),
        (40.0, -0.5),
        (60.0, -0.5),
        (np.nextafter(np.float32(60), np.float32(100)), -1.0),
        (100.0, -1.0),
    ],
)
def test_the_bounds_of_the_range_belong_to_it(x, expected):
    u = np.array([[Z_1, Z_1, 0.25, 0.25, 0.5]])
    assert proposed(Safe(), history(x, INSIDE), u)[0, 0] == pytest.approx(expected, abs=1e-14)
    assert proposed(Safe(), history(INSIDE, x), u)[0, 1] == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize(
    ("v", "g", "action", "expected"),
    [
        (40.0, 60.0, [-0.9, 0.1, 0.7], 3 * HALF),
        (BELOW, INSIDE, [-0.25, 0.0, 0.0], -1.5 * 0.75**2 - 0.5 * np.log(2 * np.pi / 3) + 2 * HALF),
        (INSIDE, ABOVE, [0.0, -1.0, 0.0], TOWARDS + 2 * HALF),
        (BELOW, ABOVE, [1.0, 1.0, 0.0], TOWARDS + AWAY + HALF),
    ],
)
def test_its_log_density_is_its_formula(v, g, action, expected):
    found = log_density_of(Safe(), history(v, g), np.array([action], dtype=np.float32))
    assert found == pytest.approx([expected], abs=1e-14)


@pytest.mark.parametrize(
    ("v", "g", "expected"),
    [(BELOW, ABOVE, [True, True]), (INSIDE, ABOVE, [False, True]), (INSIDE, INSIDE, [False, False])],
)
def test_point_masses_are_only_where_it_steers(v, g, expected):
    """Elsewhere float32 rounds a density to ±1, which `importance` must not take for a mass."""
    corner, given = np.array([[1.0, -1.0, 1.0]], dtype=np.float32), at_start(history(v, g), Safe().needs)
    safe, random = (distribution(policy, given) for policy in (Safe(), POLICIES["random"]()))
    assert safe.atoms(corner).tolist() == [[*expected, False]]
    assert not safe.atoms(0.5 * corner).any()
    assert not random.atoms(corner).any()
