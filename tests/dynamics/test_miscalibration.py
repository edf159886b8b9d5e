"""Mis-calibration: the turning direction φ with its domain δ and response ψ."""

from __future__ import annotations

import itertools

import mpmath
import pytest
from helpers.examples import tries
from hypothesis import given
from hypothesis import strategies as st

from ibdata.dynamics.miscalibration import (
    PHI_MAX,
    RHO_S,
    SAFE_ZONE,
    direction_step,
    effective_shift,
    entered_domain,
    entered_response,
    reflected_direction,
    sgn,
    turned_response,
    update_direction,
)

examples = tries(300)
SIGNS = (-1, 1)
PHIS = range(-PHI_MAX, PHI_MAX + 1)
SHIFTS = (-1.5, -1.0, -0.5, -0.13, -SAFE_ZONE, -0.1, 0.0, 0.1, SAFE_ZONE, 0.13, 0.5, 1.0, 1.5)
EVERYTHING = list(itertools.product(SIGNS, SIGNS, PHIS, SHIFTS))


def track(shifts, state=(1, 1, 0)):
    """The states (δ, ψ, φ) after each effective shift, from the state of a start."""
    states = []
    for he in shifts:
        state = update_direction(*state, he)
        states.append(state)
    return states


def directions(shifts, state=(1, 1, 0)):
    return [phi for _, _, phi in track(shifts, state)]


def test_the_safe_zone_is_the_rounded_value_of_its_formula():
    with mpmath.workdps(50):
        assert float(mpmath.sin(mpmath.pi / 12) / 2) == SAFE_ZONE  # 15° = π/12
    assert round(SAFE_ZONE, 4) == 0.1294  # the paper prints 0.1309, which is π/24


@pytest.mark.parametrize(
    ("h", "p", "he"),
    [
        (50.0, 50.0, 0.0),  # 2.5 - 1 - 1.5
        (60.0, 50.0, 0.5),
        (50.0, 75.0, -0.5),
        (70.0, 0.0, 1.5),  # 3.5 - 0 - 1.5 = 2 is clipped
        (0.0, 0.0, -1.5),
        (0.0, 100.0, -1.5),  # -3.5 is clipped
    ],
)
def test_the_effective_shift_is_clipped_at_one_and_a_half(h, p, he):
    assert effective_shift(h, p) == he


@examples
@given(st.floats(45.0, 55.0), st.floats(45.0, 55.0), st.floats(0.0, 5.0))
def test_the_effective_shift_rises_by_a_20th_of_the_shift_and_falls_by_a_50th_of_the_setpoint(h, p, more):
    """Within these ranges nothing is clipped."""
    here = effective_shift(h, p)
    assert effective_shift(h + more, p) - here == pytest.approx(more / 20.0, abs=1e-14)
    assert effective_shift(h, p + more) - here == pytest.approx(-more / 50.0, abs=1e-14)


@examples
@given(st.floats(allow_nan=False))
def test_the_sign_times_the_size_is_the_number(x):
    assert sgn(x) in (-1, 0, 1)
    assert x == 0.0 or sgn(x) * abs(x) == x
    assert sgn(0.0) == sgn(-0.0) == 0


@pytest.mark.parametrize("delta", SIGNS)
def test_the_domain_is_the_side_of_the_shift_and_stays_in_the_safe_zone(delta):
    assert [entered_domain(delta, he) for he in (-1.0, -0.13, 0.13, 1.0)] == [-1, -1, 1, 1]
    assert [entered_domain(delta, he) for he in (-SAFE_ZONE, 0.0, SAFE_ZONE)] == [
        delta
    ] * 3  # |hᵉ| = z is still safe


@pytest.mark.parametrize(
    ("psi", "delta", "delta_hat", "after"), [(-1, 1, -1, 1), (-1, -1, 1, 1), (-1, 1, 1, -1), (1, -1, -1, 1)]
)
def test_a_change_of_domain_makes_the_response_advantageous(psi, delta, delta_hat, after):
    assert entered_response(psi, delta, delta_hat) == after


@pytest.mark.parametrize(
    ("phi", "delta_hat", "psi_hat", "he", "step"),
    [
        (4, 1, 1, 0.0, -1),  # safe: back towards 0
        (4, 1, 1, SAFE_ZONE, -1),  # |hᵉ| = z is still safe
        (0, 1, 1, 0.0, 0),
        (-6, 1, -1, 0.5, 0),  # held at the opposite bound -6 δ̂
        (6, -1, -1, -0.5, 0),
        (6, 1, -1, 0.5, -1),  # at the own bound it turns
        (4, 1, 1, 0.5, 1),  # ψ̂ · sgn(hᵉ)
        (4, 1, -1, 0.5, -1),
        (-4, -1, 1, -0.5, -1),
    ],
)
def test_the_direction_returns_is_held_or_turns(phi, delta_hat, psi_hat, he, step):
    assert direction_step(phi, delta_hat, psi_hat, he) == step


def test_a_direction_of_six_makes_the_response_disadvantageous():
    for psi in SIGNS:
        assert [turned_response(psi, phi) for phi in range(-7, 8)] == [-1, -1, *[psi] * 11, -1, -1]


def test_the_direction_is_reflected_at_six():
    # 12 - ((7 + 24) mod 24) = 12 - 7 = 5; 12 - ((-7 + 24) mod 24) = 12 - 17 = -5.
    assert [reflected_direction(phi) for phi in range(-7, 8)] == [-5, *range(-6, 7), 5]


def test_one_full_turn_of_the_optimal_policy_follows_the_sine():
    """Figure 3a: hᵉ = sin(πφ/12) for the φ of the next step, up to 6, back to 0, and mirrored."""
    up = [*range(1, 7), *range(5, -1, -1)]
    phis = up + [-phi for phi in up]
    shifts = [sgn(phi) * RHO_S[abs(phi)] for phi in phis]
    assert track(shifts) == [
        (1, 1, 1),  # out of the safe zone: δ = ψ = 1
        (1, 1, 2),
        (1, 1, 3),
        (1, 1, 4),
        (1, 1, 5),
        (1, -1, 6),  # the reversal point: ψ = -1
        (1, -1, 5),
        (1, -1, 4),
        (1, -1, 3),
        (1, -1, 2),
        (1, -1, 1),
        (1, 1, 0),  # back in the safe zone at φ = 0: reset
        (-1, 1, -1),  # the negative domain
        (-1, 1, -2),
        (-1, 1, -3),
        (-1, 1, -4),
        (-1, 1, -5),
        (-1, -1, -6),
        (-1, -1, -5),
        (-1, -1, -4),
        (-1, -1, -3),
        (-1, -1, -2),
        (-1, -1, -1),
        (1, 1, 0),  # δ is 1 again
    ]


def test_a_turn_that_gives_up_half_way_goes_back_step_by_step():
    """Figure 3b: Δh = +1 +1 +1 -1 -1 -1 from hᵉ = 0, one action being 0.2876 of hᵉ, then no action."""
    step = 0.28757671678
    shifts = [step * k for k in (1, 2, 3, 2, 1, 0, 0, 0, 0, 0)]
    assert directions(shifts) == [1, 2, 3, 4, 5, 4, 3, 2, 1, 0]


def test_a_constant_shift_ends_at_the_opposite_bound_and_stays():
    """Figure 3c."""
    assert directions([1.0] * 22) == [*range(1, 7), *range(5, -7, -1), *[-6] * 4]
    assert track([1.0] * 22)[-1] == (1, -1, -6)


def test_a_jump_to_the_other_side_at_the_opposite_bound_is_reflected():
    """δ changes at φ = -6, so that φ̂ = -7, which is reflected to -5; ψ is -1 at once."""
    assert update_direction(1, -1, -6, -1.0) == (-1, -1, -5)
    assert update_direction(-1, -1, 6, 1.0) == (1, -1, 5)


@pytest.mark.parametrize("start", list(itertools.product(SIGNS, SIGNS, PHIS)))
def test_the_safe_zone_brings_the_start_back_within_six_steps(start):
    states = track([0.0] * 7, start)
    assert states[5:] == [(1, 1, 0)] * 2
    assert [abs(phi) for _, _, phi in states] == [max(0, abs(start[2]) - i) for i in range(1, 8)]


def test_every_step_keeps_the_latents_in_their_ranges_and_moves_the_direction_by_at_most_one():
    for delta, psi, phi, he in EVERYTHING:
        delta_next, psi_next, phi_next = update_direction(delta, psi, phi, he)
        assert delta_next in SIGNS
        assert psi_next in SIGNS
        assert phi_next in PHIS
        assert abs(phi_next - phi) <= 1


def test_the_two_domains_are_mirror_images_but_for_the_reset():
    """At φ = 0 in the safe zone both sides are reset to δ = 1, which is no mirror image."""
    for delta, psi, phi, he in EVERYTHING:
        here, there = update_direction(delta, psi, phi, he), update_direction(-delta, psi, -phi, -he)
        if here[2] == 0 and abs(he) <= SAFE_ZONE:
            assert here == there == (1, 1, 0)
        else:
            assert there == (-here[0], here[1], -here[2])


@examples
@given(st.lists(st.floats(-1.5, 1.5), min_size=1, max_size=60))
def test_whatever_the_shifts_a_bound_is_only_met_with_the_disadvantageous_response(shifts):
    for _, psi, phi in track(shifts):
        assert abs(phi) < PHI_MAX or psi == -1
