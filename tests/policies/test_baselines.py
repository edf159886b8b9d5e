"""The three baselines of the Siemens offline data, compared with numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.asking import action_of, proposed

from ibdata.policies import POLICIES
from ibdata.policies.optimized import MEAN, STD

Bad, Mediocre, Optimized = (POLICIES[kind] for kind in ("bad", "mediocre", "optimized"))
NO_DRAWS = np.empty((1, 0))
P, V, G, H, F, C = range(6)


def now(v, g, h):
    """One lane in which everything but velocity, gain and shift would mislead."""
    return np.array([[[70.0, v, g, h, 30.0, 200.0]]], dtype=np.float32)


def past(**values):
    """One lane (1, 6, 6) at the mean of every column, but for values such as h3=78.67."""
    history = np.tile(np.array(MEAN), (1, 6, 1))
    for name, value in values.items():
        history[0, int(name[1]), "pvghfc".index(name[0])] = value
    return history.astype(np.float32)


def optimized(**values):
    return np.asarray(proposed(Optimized(), past(**values), NO_DRAWS))[0]


def test_bad_is_the_way_to_100_in_raw_units():
    # 100 - 50 = 50, 100 - 99.5 = 0.5, 100 - 100 = 0; what is above 1 is clipped when it is applied.
    assert np.asarray(proposed(Bad(), now(50.0, 99.5, 100.0), NO_DRAWS)).tolist() == [[50.0, 0.5, 0.0]]
    assert action_of(Bad(), now(50.0, 99.5, 100.0)).tolist() == [[1.0, 0.5, 0.0]]


def test_mediocre_is_the_way_to_25_in_raw_units():
    # 25 - 25 = 0, 25 - 24.75 = 0.25, 25 - 27 = -2
    assert np.asarray(proposed(Mediocre(), now(25.0, 24.75, 27.0), NO_DRAWS)).tolist() == [[0.0, 0.25, -2.0]]
    assert action_of(Mediocre(), now(25.0, 24.75, 27.0)).tolist() == [[0.0, 0.25, -1.0]]


def test_the_distance_is_taken_in_doubles():
    # 25 and the float32 just above 24.9: their difference has more digits than a float32 near 25.
    x = np.float32(24.9)
    assert np.asarray(proposed(Mediocre(), now(x, x, x), NO_DRAWS))[0, 0] == 25.0 - float(x)


def test_optimized_at_the_mean_of_everything_is_its_constants():
    # All z are 0; 1.43 is clipped when it is applied. The means are rounded to float32 in a history.
    assert optimized() == pytest.approx([-0.91, 1.43, 0.81], abs=1e-6)
    assert action_of(Optimized(), past()).tolist()[0][1] == 1.0


def test_the_velocity_follows_the_velocity_five_steps_ago():
    # v(5) = 48.75 - 12.31 = 36.44: z = -1, Δv = 1 - 0.91 = 0.09
    assert optimized(v5=36.44)[0] == pytest.approx(0.09, abs=1e-6)


def test_the_gain_follows_the_fatigue_three_steps_ago_and_the_setpoint():
    # f(3) = 37.51 - 15.585 = 21.925: z = -½, Δg = -1 + 1.43 = 0.43
    assert optimized(f3=21.925)[1] == pytest.approx(0.43, abs=1e-6)
    # p = 55 + 28.72 = 83.72: z = 1, Δg = -1 + 1.43 = 0.43
    assert optimized(p0=83.72)[1] == pytest.approx(0.43, abs=1e-6)


def test_the_shift_follows_the_shift_three_and_four_steps_ago_and_the_setpoint():
    # z_h(3) = (52.372 - 49.45) / 29.22 = 0.1: Δh = -0.348 + 0.81 = 0.462
    assert optimized(h3=52.372)[2] == pytest.approx(0.462, abs=1e-6)
    # z_h(4) = 0.5: Δh = -0.5 + 0.81 = 0.31
    assert optimized(h4=64.06)[2] == pytest.approx(0.31, abs=1e-6)
    # z_p = -0.5: Δh = -1 + 0.81 = -0.19
    assert optimized(p0=40.64)[2] == pytest.approx(-0.19, abs=1e-6)


def test_nothing_else_of_the_history_matters():
    used = {"p0", "v5", "f3", "h3", "h4"}
    for k in range(6):
        for name in "pvghfc":
            same = optimized(**{f"{name}{k}": 99.0}).tolist() == optimized().tolist()
            assert same == (f"{name}{k}" not in used)


def test_the_statistics_are_those_of_the_source():
    """Of the setpoint: those of 10, 20, …, 100, so of a batch over ten setpoints."""
    setpoints = np.arange(10.0, 101.0, 10.0)
    assert (MEAN[P], STD[P]) == (setpoints.mean(), round(setpoints.std(), 2))
    assert MEAN == (55.0, 48.75, 50.53, 49.45, 37.51, 166.33)
    assert STD == (28.72, 12.31, 29.91, 29.22, 31.17, 139.44)
