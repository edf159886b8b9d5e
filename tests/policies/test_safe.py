"""The safe policy: towards the medium range from outside, uniform inside."""

from __future__ import annotations

from statistics import NormalDist

import mpmath
import numpy as np
import pytest
from helpers.asking import log_density_of, proposed

from ibdata.policies import POLICIES
from ibdata.policies import safe as module
from ibdata.policies.base import at_start

Safe = POLICIES["safe"]
BELOW, INSIDE, ABOVE = 20.0, 50.0, 80.0
# Φ((z - ½) √3) at z = 0, -1 and 1; the draws that make these z.
Z_0, Z_MINUS_1, Z_1 = (NormalDist(0.5, 3**-0.5).cdf(z) for z in (0.0, -1.0, 1.0))
SD = 3**-0.5


def history(v, g):
    """One lane in which everything but velocity and gain would mislead."""
    return np.array([[[10.0, v, g, 90.0, 30.0, 70.0]]], dtype=np.float32)


def act(v, g, u):
    return np.asarray(proposed(Safe(), history(v, g), np.array([u])))[0]


def log_prob(v, g, action):
    return float(log_density_of(Safe(), history(v, g), np.array([action], dtype=np.float32))[0])


def exactly(expression):
    """The double nearest to what mpmath makes of an expression with 200 bits."""
    with mpmath.workprec(200):
        return float(expression())


def normal_mass(z):
    """P(Z <= z) for Z ~ N(½, 1/√3)."""
    return mpmath.ncdf((z - mpmath.mpf(1) / 2) * mpmath.sqrt(3))


CONSTANTS = {
    "SD": lambda: 1 / mpmath.sqrt(3),
    "LOG_SD_SQRT_2PI": lambda: mpmath.log(mpmath.sqrt(2 * mpmath.pi) / mpmath.sqrt(3)),
    "LOG_MASS_TOWARDS": lambda: mpmath.log(1 - normal_mass(1)),
    "LOG_MASS_AWAY": lambda: mpmath.log(normal_mass(-1)),
    "LOG_HALF": lambda: mpmath.log(mpmath.mpf(1) / 2),
}


@pytest.mark.parametrize("name", CONSTANTS)
def test_every_constant_is_its_formula_rounded_to_a_double(name):
    assert getattr(module, name) == exactly(CONSTANTS[name])


def test_the_medium_range_and_the_mean_are_those_of_the_source():
    assert (module.LOW, module.HIGH, module.MEAN) == (40.0, 60.0, 0.5)


def test_a_uniform_of_one_half_moves_by_the_mean_towards_the_range():
    # Φ⁻¹(½) = 0, so z = ½.
    half = [0.5] * 5
    assert act(BELOW, ABOVE, half).tolist() == [0.5, -0.5, 0.0]
    assert act(ABOVE, BELOW, half).tolist() == [-0.5, 0.5, 0.0]


def test_z_is_the_mean_and_a_standard_deviation_times_the_normal():
    # Φ⁻¹(Φ(1)) = 1: z = ½ + 1/√3 = 1.0774, not yet clipped.
    u = NormalDist().cdf(1.0)
    assert act(BELOW, ABOVE, [u] * 5)[:2] == pytest.approx([0.5 + SD, -0.5 - SD], abs=1e-14)
    assert act(BELOW, BELOW, [Z_0] * 5)[:2] == pytest.approx([0.0, 0.0], abs=1e-14)


@pytest.mark.parametrize(
    ("x", "region"),
    [
        (0.0, 1),
        (np.nextafter(np.float32(40), np.float32(0)), 1),
        (40.0, 0),
        (60.0, 0),
        (np.nextafter(np.float32(60), np.float32(100)), -1),
        (100.0, -1),
    ],
)
def test_the_bounds_of_the_range_belong_to_it(x, region):
    u = [Z_1, Z_1, 0.25, 0.25, 0.5]
    expected = -0.5 if region == 0 else float(region)
    assert act(x, INSIDE, u)[0] == pytest.approx(expected, abs=1e-14)
    assert act(INSIDE, x, u)[1] == pytest.approx(expected, abs=1e-14)


def test_each_component_uses_its_own_draws():
    # Draws 0 and 1 are the normals of v and g, 2 and 3 their uniforms, 4 the shift's.
    u = [0.5, Z_0, 0.25, 0.625, 0.875]
    assert act(BELOW, BELOW, u) == pytest.approx([0.5, 0.0, 0.75], abs=1e-14)
    assert act(INSIDE, INSIDE, u).tolist() == [-0.5, 0.25, 0.75]
    assert act(BELOW, INSIDE, u).tolist() == [0.5, 0.25, 0.75]
    assert act(INSIDE, ABOVE, u) == pytest.approx([-0.5, 0.0, 0.75], abs=1e-14)


def test_the_uniform_actions_have_log_density_log_one_half_each():
    assert log_prob(INSIDE, INSIDE, [0.5, -0.5, 0.0]) == 3 * module.LOG_HALF
    # The same for every action inside.
    assert log_prob(40.0, 60.0, [-0.9, 0.1, 0.7]) == 3 * module.LOG_HALF


def test_the_density_outside_the_range_is_the_normals():
    # -½ ((x - ½) √3)² - log(√(2π)/√3) at x = ½ and x = -¼, turned round above the range; ½ · ½ for g, h.
    for x in (0.5, -0.25, 0.0):
        expected = -1.5 * (x - 0.5) ** 2 - 0.5 * np.log(2 * np.pi / 3) - 2 * np.log(2.0)
        assert log_prob(BELOW, INSIDE, [x, 0.0, 0.0]) == pytest.approx(expected, abs=1e-14)
        assert log_prob(ABOVE, INSIDE, [-x, 0.0, 0.0]) == pytest.approx(expected, abs=1e-14)
        assert log_prob(INSIDE, BELOW, [0.0, x, 0.0]) == pytest.approx(expected, abs=1e-14)
        assert log_prob(INSIDE, ABOVE, [0.0, -x, 0.0]) == pytest.approx(expected, abs=1e-14)


def test_a_clipped_action_has_the_mass_of_its_tail():
    towards = module.LOG_MASS_TOWARDS + 2 * module.LOG_HALF
    away = module.LOG_MASS_AWAY + 2 * module.LOG_HALF
    assert log_prob(BELOW, INSIDE, [1.0, 0.0, 0.0]) == pytest.approx(towards, abs=1e-15)
    assert log_prob(BELOW, INSIDE, [-1.0, 0.0, 0.0]) == pytest.approx(away, abs=1e-15)
    assert log_prob(ABOVE, INSIDE, [-1.0, 0.0, 0.0]) == pytest.approx(towards, abs=1e-15)
    assert log_prob(ABOVE, INSIDE, [1.0, 0.0, 0.0]) == pytest.approx(away, abs=1e-15)
    both = module.LOG_MASS_TOWARDS + module.LOG_MASS_AWAY + module.LOG_HALF
    assert log_prob(BELOW, ABOVE, [1.0, 1.0, 0.0]) == pytest.approx(both, abs=1e-15)


@pytest.mark.parametrize("v", [BELOW, ABOVE])
def test_actions_are_clipped_as_often_as_the_masses_say(v):
    """With evenly spaced draws the counts are exact up to the one at the bound."""
    n = 100_000
    u = np.full((n, 5), 0.5)
    u[:, 0] = (np.arange(n) + 0.5) / n
    action = np.asarray(proposed(Safe(), np.repeat(history(v, INSIDE), n, axis=0), u))[:, 0]
    side = 1.0 if v == BELOW else -1.0
    assert (side * action >= 1.0).sum() == pytest.approx(n * np.exp(module.LOG_MASS_TOWARDS), abs=1)
    assert (side * action <= -1.0).sum() == pytest.approx(n * np.exp(module.LOG_MASS_AWAY), abs=1)


@pytest.mark.parametrize("v", [BELOW, ABOVE])
def test_the_clipped_normal_integrates_to_1_with_its_two_masses(v):
    nodes, weights = np.polynomial.legendre.leggauss(40)
    inside = sum(w * np.exp(log_prob(v, INSIDE, [x, 0.0, 0.0])) for x, w in zip(nodes, weights, strict=True))
    masses = sum(np.exp(log_prob(v, INSIDE, [x, 0.0, 0.0])) for x in (-1.0, 1.0))
    assert 4.0 * (inside + masses) == pytest.approx(1.0, abs=1e-7)  # ½ for g, ½ for h


def test_the_draws_that_make_z_minus_1_and_1_bound_the_tails():
    assert pytest.approx(np.log(Z_MINUS_1), abs=1e-13) == module.LOG_MASS_AWAY
    assert pytest.approx(np.log(1.0 - Z_1), abs=1e-13) == module.LOG_MASS_TOWARDS


def test_there_are_point_masses_at_the_edges_only_where_velocity_and_gain_are_steered():
    """Elsewhere float32 rounds a density to ±1, which `importance` must not take for a mass."""
    corner = np.array([[1.0, -1.0, 1.0]], dtype=np.float32)
    for v, g, expected in (
        (BELOW, ABOVE, [True, True]),
        (INSIDE, ABOVE, [False, True]),
        (INSIDE, INSIDE, [False] * 2),
    ):
        given = at_start(history(v, g), Safe().needs)
        assert Safe().atoms(given, corner).tolist() == [[*expected, False]]
        assert not Safe().atoms(given, 0.5 * corner).any()
        assert not POLICIES["random"]().atoms(given, corner).any()
