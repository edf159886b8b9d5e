"""Consumption and reward."""

from __future__ import annotations

import pytest
from helpers.examples import tries
from hypothesis import given
from hypothesis import strategies as st

from ibdata.dynamics.consumption import consumption, expected_consumption, reward

examples = tries(200)
cost = st.floats(-25.0, 5000.0)
normal = st.floats(-8.3, 8.3)
k = st.sampled_from([0.02, 0.005])


@pytest.mark.parametrize(
    ("theta_c", "m", "offset", "c_hat"),
    [
        (70.0, -0.5, 0.0, 57.5),  # 70 - 12.5
        (70.0, -0.5, 1.0, 82.5),  # 70 + 25 · 0.5
        (70.0, -1.0, 1.0, 70.0),  # the best penalty cancels the offset
    ],
)
def test_the_expected_consumption_adds_25_times_penalty_and_offset(theta_c, m, offset, c_hat):
    assert expected_consumption(theta_c, m, offset) == c_hat


@examples
@given(st.floats(0.0, 5000.0), st.floats(-1.0, 1.24))
def test_an_offset_of_one_costs_25_everywhere(theta_c, m):
    difference = expected_consumption(theta_c, m, 1.0) - expected_consumption(theta_c, m, 0.0)
    assert difference == pytest.approx(25.0, abs=1e-11)


@pytest.mark.parametrize(
    ("c_hat", "z", "k", "c"),
    [
        (100.0, 1.0, 0.02, 103.0),  # standard deviation 1 + 2
        (100.0, -2.0, 0.005, 97.0),  # standard deviation 1 + 0.5, times -2
        (0.0, 1.0, 0.02, 1.0),
    ],
)
def test_the_noise_of_the_consumption_has_the_standard_deviation_1_plus_k_c_hat(c_hat, z, k, c):
    assert consumption(c_hat, z, k) == pytest.approx(c, rel=1e-15)


@examples
@given(cost, k)
def test_without_noise_the_consumption_is_the_expected_one(c_hat, k):
    assert consumption(c_hat, 0.0, k) == c_hat


@examples
@given(cost, normal, normal, k)
def test_the_consumption_is_linear_in_its_noise(c_hat, z1, z2, k):
    noise = [consumption(c_hat, z, k) - c_hat for z in (z1, z2, z1 + z2)]
    assert noise[0] + noise[1] == pytest.approx(noise[2], abs=1e-10)


def test_the_reward_charges_fatigue_three_times():
    assert reward(100.0, 20.0) == -160.0  # -100 - 3 · 20


@examples
@given(cost, st.floats(0.0, 300.0), st.floats(0.0, 100.0))
def test_more_consumption_or_fatigue_never_pays(c, f, more):
    assert reward(c + more, f) <= reward(c, f)
    assert reward(c, f + more) == pytest.approx(reward(c, f) - 3.0 * more, abs=1e-10)
