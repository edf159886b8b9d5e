"""Fatigue: effective values, their noise, the hidden μ, and the bifurcation of α."""

from __future__ import annotations

import math

import pytest
from helpers.examples import tries
from hypothesis import given
from hypothesis import strategies as st

from ibdata.dynamics import PAPER, SIEMENS
from ibdata.dynamics.fatigue import (
    amplification,
    basic_fatigue,
    bernoulli,
    effective_gain,
    effective_velocity,
    fatigue,
    gain_transform,
    mixed_noise,
    noise_component,
    squashed_exponential,
    update_mu,
    velocity_transform,
)

examples = tries(200)
percent = st.floats(0.0, 100.0)
unit = st.floats(0.0, 1.0)
mus = st.floats(0.0, 5.0)
exponentials = st.floats(0.0, 36.8)
variants = pytest.mark.parametrize("variant", [SIEMENS, PAPER], ids=["siemens", "paper"])
SIEMENS_ENDS = (100.0, 0.0, 0.0, 100.0)
PAPER_ENDS = (0.0, 100.0, 100.0, 0.0)


def test_the_velocity_transform_is_a_ratio_of_sums():
    assert velocity_transform(50.0, 50.0, 50.0) == 102.0 / 101.0  # (50 + 50 + 2) / (50 - 50 + 101)
    assert velocity_transform(0.0, 100.0, 100.0) == 202.0  # 202 / 1


@examples
@given(percent, percent, percent, percent)
def test_the_velocity_transform_grows_with_gain_and_falls_with_velocity(a, b, other, p):
    low, high = sorted((a, b))
    assert velocity_transform(other, low, p) <= velocity_transform(other, high, p)
    assert velocity_transform(high, other, p) <= velocity_transform(low, other, p)


def test_the_gain_transform_is_an_inverse():
    assert gain_transform(49.0, 50.0) == 0.01  # 1 / (49 + 50 + 1)


@examples
@given(percent, percent)
def test_the_gain_transform_times_its_denominator_is_one(g, p):
    assert gain_transform(g, p) * (g + p + 1.0) == pytest.approx(1.0, rel=1e-15)


def test_the_effective_velocity_of_the_usual_start_is_51_202ths():
    # (102/101 - 52/151) / (152/51 - 52/151) = (10150/101) / (20300/51) = 51/202, and 1 - 51/202 as printed.
    assert effective_velocity(50.0, 50.0, 50.0, *SIEMENS_ENDS) == pytest.approx(51 / 202, rel=1e-14)
    assert effective_velocity(50.0, 50.0, 50.0, *PAPER_ENDS) == pytest.approx(151 / 202, rel=1e-14)


@pytest.mark.parametrize(("v0", "g0", "v1", "g1"), [SIEMENS_ENDS, PAPER_ENDS], ids=["siemens", "paper"])
@examples
@given(v=percent, g=percent, p=percent)
def test_the_effective_velocity_is_exactly_0_and_1_at_its_ends_and_between_elsewhere(v0, g0, v1, g1, v, g, p):
    assert effective_velocity(v0, g0, p, v0, g0, v1, g1) == 0.0
    assert effective_velocity(v1, g1, p, v0, g0, v1, g1) == 1.0
    assert 0.0 <= effective_velocity(v, g, p, v0, g0, v1, g1) <= 1.0


def test_the_effective_gain_of_half_gain_at_setpoint_0_is_one_102th():
    # (1/51 - 1/101) / (1 - 1/101) = (50/5151) / (100/101) = 1/102.
    assert effective_gain(50.0, 0.0) == pytest.approx(1 / 102, rel=1e-14)


@examples
@given(percent, percent, percent)
def test_the_effective_gain_falls_from_exactly_1_to_exactly_0(a, b, p):
    low, high = sorted((a, b))
    assert effective_gain(0.0, p) == 1.0
    assert effective_gain(100.0, p) == 0.0
    assert 0.0 <= effective_gain(high, p) <= effective_gain(low, p) <= 1.0


@pytest.mark.parametrize(
    ("u", "effective", "low", "high", "b"),
    [
        (0.29, 0.3, 0.0, 1.0, 1.0),
        (0.30, 0.3, 0.0, 1.0, 0.0),  # u < p, strictly
        (0.0005, 0.0, 0.001, 0.999, 1.0),  # the clipped probability is 0.001
        (0.0005, 0.0, 0.0, 1.0, 0.0),
        (0.9995, 1.0, 0.001, 0.999, 0.0),  # the clipped probability is 0.999
        (0.9995, 1.0, 0.0, 1.0, 1.0),
    ],
)
def test_an_event_happens_where_its_uniform_is_below_the_clipped_probability(u, effective, low, high, b):
    assert bernoulli(u, effective, low, high) == b


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (0.001, 0.999)])
def test_events_are_as_frequent_as_their_probability(low, high):
    """Over 2000 evenly spaced uniforms, the share of events is the clipped probability."""
    for effective in (0.0, 0.25, 0.5, 0.9, 1.0):
        share = sum(bernoulli((i + 0.5) / 2000.0, effective, low, high) for i in range(2000)) / 2000.0
        assert share == pytest.approx(min(max(effective, low), high), abs=1e-9)


def test_the_exponential_noise_is_squashed_by_a_logistic():
    # 2 (σ(0.1 e) - ½) = tanh(0.05 e), at e = 2: tanh 0.1 = 0.0996679946. σ(0.05 · 2) = 0.5249791875.
    assert squashed_exponential(2.0, 0.1, 2.0, 0.5) == pytest.approx(0.09966799462495582, rel=1e-14)
    assert squashed_exponential(2.0, 0.05, 1.0, 0.0) == pytest.approx(0.52497918747894, rel=1e-14)


@examples
@given(exponentials, exponentials)
def test_the_squashed_noise_grows_from_its_value_at_zero_and_stays_below_one(a, b):
    low, high = sorted((a, b))
    for mean, scale, shift, least in ((0.1, 2.0, 0.5, 0.0), (0.05, 1.0, 0.0, 0.5)):
        values = [squashed_exponential(e, mean, scale, shift) for e in (low, high)]
        assert least <= values[0] <= values[1] < 1.0


def test_the_noise_mixes_in_the_event_times_the_effective_value():
    assert mixed_noise(0.5, 0.5, 1.0, 0.8) == 0.7  # 0.5 + 0.5 · 0.5 · 0.8
    assert mixed_noise(0.2, 1.0, 1.0, 1.0) == 1.0
    assert mixed_noise(0.2, 0.9, 0.0, 0.8) == 0.2


@examples
@given(unit, unit, st.sampled_from([0.0, 1.0]), unit)
def test_the_mixed_noise_lies_between_the_exponential_part_and_one(eta_e, u, b, effective):
    assert eta_e <= mixed_noise(eta_e, u, b, effective) <= 1.0


def test_a_noise_component_is_made_of_its_three_draws():
    # tanh 0.1 = 0.0996679946; + 0.9003320054 · 0.5 · 0.8 = 0.4598007968. With 0.5249791875: 0.7149875125.
    assert noise_component(2.0, 0.5, 0.1, 0.8, SIEMENS.parameters) == pytest.approx(0.4598007968, abs=1e-10)
    assert noise_component(2.0, 0.5, 0.1, 0.8, PAPER.parameters) == pytest.approx(0.7149875125, abs=1e-10)
    assert noise_component(2.0, 0.5, 0.9, 0.8, PAPER.parameters) == pytest.approx(0.5249791875, abs=1e-10)


@variants
@examples
@given(e=exponentials, u=unit, u_event=unit, effective=unit)
def test_a_noise_component_lies_in_the_unit_interval(variant, e, u, u_event, effective):
    assert 0.0 <= noise_component(e, u, u_event, effective, variant.parameters) <= 1.0


@pytest.mark.parametrize(
    ("mu", "effective", "eta", "after"),
    [
        (3.0, 0.05, 0.9, 0.05),  # reset at 0.05 and below, whatever μ was
        (0.3, 0.0, 0.9, 0.0),
        (3.0, 0.0500001, 0.9, 3.3),  # above 0.05 it runs away: 1.1 · 3
        (1.2, 0.5, 0.9, 1.32),  # from 1.2 on: 1.1 · 1.2
        (4.8, 0.5, 0.9, 5.0),  # 5.28 is capped
        (1.1999, 0.5, 0.3, 1.17991),  # 0.9 · 1.1999 + 0.1
        (0.0, 0.5, 0.6, 0.2),
    ],
)
def test_a_hidden_value_is_reset_runs_away_or_follows_its_noise(mu, effective, eta, after):
    assert update_mu(mu, effective, eta) == pytest.approx(after, rel=1e-14, abs=0.0)


def test_a_run_away_takes_15_steps_to_its_cap():
    mu, steps = 1.2, 0  # 1.2 · 1.1¹⁴ = 4.557, 1.2 · 1.1¹⁵ = 5.013
    while mu < 5.0:
        mu, steps = update_mu(mu, 0.5, 0.0), steps + 1
    assert steps == 15
    assert update_mu(mu, 0.5, 0.0) == 5.0


@examples
@given(mus, unit, unit)
def test_a_hidden_value_stays_in_0_to_5_and_is_the_effective_value_up_to_0_05(mu, effective, eta):
    after = update_mu(mu, effective, eta)
    assert 0.0 <= after <= 5.0
    assert update_mu(mu, effective / 20.0, eta) == effective / 20.0


@pytest.mark.parametrize(
    ("mu_v", "mu_g", "threshold", "alpha"),
    [
        (1.1, 1.19, 1.2, 0.3),  # max(0.2, 0.3)
        (1.2, 0.0, 1.2, 1.0 / (1.0 + math.exp(-2.8))),  # σ(2.4 + 0.4 · 1); the threshold itself counts
        (0.0, 1.2, 1.2, 1.0 / (1.0 + math.exp(-2.8))),
        (4.99, 4.99, 5.0, 0.3),
        (4.99, 5.0, 5.0, 1.0 / (1.0 + math.exp(-2.8))),
    ],
)
def test_the_amplification_bifurcates_where_a_hidden_value_reaches_the_threshold(
    mu_v, mu_g, threshold, alpha
):
    assert amplification(mu_v, mu_g, 0.2, 0.3, 1.0, threshold) == pytest.approx(alpha, rel=1e-15)


@variants
@examples
@given(mu_v=mus, mu_g=mus, eta_v=unit, eta_g=unit, z=st.floats(-8.3, 8.3))
def test_the_amplification_does_not_care_which_one_is_velocity(variant, mu_v, mu_g, eta_v, eta_g, z):
    threshold = variant.alpha_threshold
    alpha = amplification(mu_v, mu_g, eta_v, eta_g, z, threshold)
    assert alpha == amplification(mu_g, mu_v, eta_g, eta_v, z, threshold)
    assert 0.0 <= alpha <= 1.0


@pytest.mark.parametrize(
    ("v", "g", "f_b"),
    [
        (0.0, 0.0, 300.0),  # 30000 / 100
        (50.0, 50.0, 425.0 / 7.0),  # 30000/350 - 25 = 600/7 - 175/7
        (100.0, 50.0, 25.0),  # 30000/600 - 25
        (100.0, 100.0, 0.0),  # 50 - 100 is below zero
    ],
)
def test_the_basic_fatigue_falls_with_velocity_and_gain(v, g, f_b):
    assert basic_fatigue(v, g) == pytest.approx(f_b, rel=1e-15, abs=0.0)


@examples
@given(percent, percent, percent, percent)
def test_more_velocity_or_gain_never_gives_more_basic_fatigue(v1, v2, g1, g2):
    least, most = basic_fatigue(max(v1, v2), max(g1, g2)), basic_fatigue(min(v1, v2), min(g1, g2))
    assert 0.0 <= least <= basic_fatigue(v1, g1) <= most <= 300.0


@pytest.mark.parametrize(("f_b", "alpha", "f"), [(300.0, 0.0, 100.0), (300.0, 1.0, 300.0), (60.0, 0.5, 40.0)])
def test_the_fatigue_amplifies_a_third_of_the_basic_fatigue(f_b, alpha, f):
    assert fatigue(f_b, alpha) == f  # f_b (1 + 2 α) / 3


@examples
@given(st.floats(0.0, 300.0), unit)
def test_the_fatigue_is_between_a_third_and_all_of_the_basic_fatigue(f_b, alpha):
    assert f_b / 3.0 * (1.0 - 1e-15) <= fatigue(f_b, alpha) <= f_b * (1.0 + 1e-15)
