"""Mis-calibration: the turning direction φ with its domain δ and response ψ."""

from __future__ import annotations

import itertools

import mpmath
import pytest

from ibdata.dynamics.miscalibration import (
    PHI_MAX,
    RHO_S,
    SAFE_ZONE,
    direction_step,
    entered_domain,
    entered_response,
    reflected_direction,
    sgn,
    turned_response,
    update_direction,
)

SIGNS, PHIS = (-1, 1), range(-PHI_MAX, PHI_MAX + 1)
SHIFTS = (-1.5, -1.0, -0.5, -0.13, -SAFE_ZONE, -0.1, 0.0, 0.1, SAFE_ZONE, 0.13, 0.5, 1.0, 1.5)
EVERYTHING = list(itertools.product(SIGNS, SIGNS, PHIS, SHIFTS))
VALUES = [
    *((sgn, (x,), sign) for x, sign in ((-0.3, -1), (-0.0, 0), (2.0, 1), (float("inf"), 1))),
    *((entered_domain, (delta, he), sgn(he)) for delta in SIGNS for he in (-1.0, -0.13, 0.13, 1.0)),
    *((entered_domain, (delta, he), delta) for delta in SIGNS for he in (-SAFE_ZONE, 0.0, SAFE_ZONE)),
    (entered_response, (-1, 1, -1), 1),  # the domain has just changed
    (entered_response, (-1, -1, 1), 1),
    (entered_response, (-1, 1, 1), -1),
    (entered_response, (1, -1, -1), 1),
    (direction_step, (4, 1, 1, 0.0), -1),  # safe: back towards 0
    (direction_step, (4, 1, 1, SAFE_ZONE), -1),  # |hᵉ| = z is still safe
    (direction_step, (0, 1, 1, 0.0), 0),
    (direction_step, (-6, 1, -1, 0.5), 0),  # held at the opposite bound -6 δ̂
    (direction_step, (6, -1, -1, -0.5), 0),
    (direction_step, (6, 1, -1, 0.5), -1),  # at the own bound it turns
    (direction_step, (4, 1, 1, 0.5), 1),  # ψ̂ · sgn(hᵉ)
    (direction_step, (4, 1, -1, 0.5), -1),
    (direction_step, (-4, -1, 1, -0.5), -1),
    *((turned_response, (1, phi), -1 if abs(phi) >= 6 else 1) for phi in range(-7, 8)),
    # 12 - ((7 + 24) mod 24) = 12 - 7 = 5; 12 - ((-7 + 24) mod 24) = 12 - 17 = -5.
    *((reflected_direction, (phi,), {7: 5, -7: -5}.get(phi, phi)) for phi in range(-7, 8)),
    # δ changes at φ = -6, so that φ̂ = -7, which is reflected to -5; ψ is -1 at once.
    (update_direction, (1, -1, -6, -1.0), (-1, -1, -5)),
    (update_direction, (-1, -1, 6, 1.0), (1, -1, 5)),
]


def track(shifts, state=(1, 1, 0)):
    """The states (δ, ψ, φ) after each effective shift, from the state of a start."""
    states = []
    for he in shifts:
        state = update_direction(*state, he)
        states.append(state)
    return states


@pytest.mark.parametrize(("rule", "arguments", "value"), VALUES)
def test_a_rule_has_its_value_by_hand(rule, arguments, value):
    assert rule(*arguments) == value


def test_the_safe_zone_is_the_rounded_value_of_its_formula():
    with mpmath.workdps(50):
        assert float(mpmath.sin(mpmath.pi / 12) / 2) == SAFE_ZONE  # 15° = π/12
    assert round(SAFE_ZONE, 4) == 0.1294  # the paper prints 0.1309, which is π/24


def test_one_full_turn_of_the_optimal_policy_follows_the_sine():
    """Figure 3a: hᵉ = sin(πφ/12) for the φ of the next step, up to 6, back to 0, and mirrored.

    ψ turns at 6, and both it and δ are reset at φ = 0 in the safe zone.
    """
    up = [*range(1, 7), *range(5, -1, -1)]
    phis = up + [-phi for phi in up]
    shifts = [sgn(phi) * RHO_S[abs(phi)] for phi in phis]
    half = [*[1] * 5, *[-1] * 6, 1]
    assert track(shifts) == list(zip([1] * 12 + [-1] * 11 + [1], half * 2, phis, strict=True))


def test_a_turn_that_gives_up_half_way_goes_back_step_by_step():
    """Figure 3b: Δh = +1 +1 +1 -1 -1 -1 from hᵉ = 0, one action being 0.2876 of hᵉ, then no action."""
    shifts = [0.28757671678 * k for k in (1, 2, 3, 2, 1, 0, 0, 0, 0, 0)]
    assert [phi for _, _, phi in track(shifts)] == [1, 2, 3, 4, 5, 4, 3, 2, 1, 0]


def test_a_constant_shift_ends_at_the_opposite_bound_and_stays():
    """Figure 3c."""
    states = track([1.0] * 22)
    assert [phi for _, _, phi in states] == [*range(1, 7), *range(5, -7, -1), *[-6] * 4]
    assert states[-1] == (1, -1, -6)


@pytest.mark.parametrize("start", list(itertools.product(SIGNS, SIGNS, PHIS)))
def test_the_safe_zone_brings_the_start_back_within_six_steps(start):
    states = track([0.0] * 7, start)
    assert states[5:] == [(1, 1, 0)] * 2
    assert [abs(phi) for _, _, phi in states] == [max(0, abs(start[2]) - i) for i in range(1, 8)]


def test_every_step_keeps_its_ranges_and_turns_by_at_most_one():
    for delta, psi, phi, he in EVERYTHING:
        delta_next, psi_next, phi_next = update_direction(delta, psi, phi, he)
        assert delta_next in SIGNS
        assert psi_next in SIGNS
        assert phi_next in PHIS
        assert abs(phi_next - phi) <= 1
        assert abs(phi_next) < PHI_MAX or psi_next == -1


def test_the_two_domains_are_mirror_images_but_for_the_reset():
    """At φ = 0 in the safe zone both sides are reset to δ = 1, which is no mirror image."""
    for delta, psi, phi, he in EVERYTHING:
        here, there = update_direction(delta, psi, phi, he), update_direction(-delta, psi, -phi, -he)
        if here[2] == 0 and abs(he) <= SAFE_ZONE:
            assert here == there == (1, 1, 0)
        else:
            assert there == (-here[0], here[1], -here[2])
