"""The paper's figures as numbers, and the table behind the default variant `siemens`."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from ibdata.dynamics import VARIANTS, Noise, initial_state, step

D_H_IN_HE = np.sin(np.pi / 12) / 0.9  # what Δh = 1 adds to h^e: 20 sin(15°)/0.9, divided by 20
OPTIMUM = (-0.2925, -0.4627, -0.6301, -0.7799, -0.8982, -0.9739, -1.0)  # least m for |φ| = 0 … 6
PUSHED = (  # m(φ, 1.5) for φ = -6 … 6
    *(1.2303, 1.2062, 1.1297, 0.9953, 0.8058, 0.5732, 0.2947),
    *(0.0581, -0.1877, -0.4049, -0.5770, -0.6887, -0.7276),
)
RUN_AWAY = {  # variant, setpoint: median first step with max(μ) >= 1.2, percent never, percent at the cap
    ("siemens", 10): (346, 12, 20),
    ("siemens", 50): (197, 4, 34),
    ("siemens", 100): (164, 3, 38),
    ("paper", 10): (8, 0, 98),
    ("paper", 50): (7, 0, 98),
    ("paper", 100): (6, 0, 98),
}
EPISODES = 2000
STEPS = 1000


def shifted(delta_h, variant):
    """(φ, h^e, m, δ, ψ) after each of the given changes Δh, from the zero-action step at p = 50 on."""
    silent = Noise(*(np.zeros(1) for _ in Noise._fields))
    state = step(initial_state(50.0), np.zeros((1, 3)), silent, variant)
    rows = []
    for change in delta_h:
        state = step(state, [[0.0, 0.0, change]], silent, variant)
        parts = (state.direction, state.effective_shift, state.penalty, state.domain, state.response)
        rows.append([x[0] for x in parts])
    return np.array(rows).T


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_shift_that_follows_the_sine_has_the_least_penalty(variant):
    """Figure 3a: h^e = sin(πt/12) makes φ 0 → 6 → 0 → -6 → 0, at each of them with the lowest m there is."""
    sine = np.sin(np.pi * np.arange(25) / 12)
    phi, he, m, delta, psi = shifted(np.diff(sine) / D_H_IN_HE, variant)
    assert phi.tolist() == [*range(1, 7), *range(5, -7, -1), *range(-5, 1)]
    assert np.allclose(he, sine[1:], rtol=0, atol=1e-12)
    turning = phi != 0  # at 0 the sine passes through the safe zone, where m = 0
    assert np.allclose(m[turning], np.take(OPTIMUM, np.abs(phi[turning].astype(int))), rtol=0, atol=5e-5)
    assert np.allclose(m[~turning], 0.0, rtol=0, atol=1e-12)
    assert (delta[11], psi[11], delta[23], psi[23]) == (1, 1, 1, 1)  # reset after each half
    assert set(delta[12:23]) == {-1}


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_turn_given_up_goes_back_to_zero_and_pays(variant):
    """Figure 3b: back in the safe zone after six steps, φ falls to 0 in four. Staying there has m = 0."""
    phi, he, m, delta, psi = shifted([1, 1, 1, -1, -1, -1, 0, 0, 0, 0], variant)
    assert phi.tolist() == [1, 2, 3, 4, 5, 4, 3, 2, 1, 0]
    assert np.allclose(he[:6] / D_H_IN_HE, [1, 2, 3, 2, 1, 0], rtol=0, atol=1e-12)
    assert m.sum() < 0.0
    assert (delta[-1], psi[-1]) == (1, 1)


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_constant_push_ends_in_the_worst_direction(variant):
    """Figure 3c: φ rises to 6, falls step by step to -6 and stays; Δh = -1 then leads back to the start."""
    phi, he, m, _, psi = shifted([1] * 25, variant)
    assert phi.tolist() == [*range(1, 7), *range(5, -7, -1), *[-6] * 7]
    assert he[5:].tolist() == [1.5] * 20
    assert np.allclose(m[5:18], PUSHED[::-1], rtol=0, atol=5e-5)
    assert np.allclose(m[18:], PUSHED[0], rtol=0, atol=5e-5)
    assert psi.tolist() == [1] * 5 + [-1] * 20
    down = [-2.5 / D_H_IN_HE / 9] * 9  # h stands at 100, where h^e would be 2.5 but for its bound
    phi, he, *_ = shifted([1] * 25 + down + [0] * 6, variant)
    assert abs(he[-1]) < 1e-12
    assert phi[-7:].tolist() == [-5, -4, -3, -2, -1, 0, 0]


@cache
def random_rollouts(variant, setpoint):
    """First recorded step with max(μ) >= 1.2, and with it 5 (∞: never), and the share of steps at 5.

    Uniform random actions; the step after the zero-action step is the first recorded one, number 1.
    """
    rng = np.random.default_rng([setpoint, *variant.encode()])
    nothing = np.zeros(EPISODES)
    state = initial_state(np.full(EPISODES, float(setpoint)))
    run_away, cap, dropped = (np.full(EPISODES, np.inf) for _ in range(3))
    at_cap = 0
    for t in range(STEPS + 1):
        action = np.zeros((EPISODES, 3)) if t == 0 else rng.uniform(-1.0, 1.0, (EPISODES, 3))
        exponentials, uniforms = rng.standard_exponential((2, EPISODES)), rng.random((4, EPISODES))
        noise = Noise(*exponentials, *uniforms, *[nothing] * 6)  # the others reach neither μ
        state = step(state, action, noise, variant)
        mu = np.maximum(state.mu_v, state.mu_g)
        if t > 0:
            np.minimum(run_away, np.where(mu >= 1.2, t, np.inf), out=run_away)
            np.minimum(cap, np.where(mu >= 5.0, t, np.inf), out=cap)
            np.minimum(dropped, np.where((mu < 1.2) & (run_away < t), t, np.inf), out=dropped)
            at_cap += np.count_nonzero(mu >= 5.0)
    return run_away, cap, dropped, at_cap / (EPISODES * STEPS)


def core(keys, *quick):
    """Parameters, of which all but a few quick ones are slow."""
    return [pytest.param(*key, marks=() if key in quick else pytest.mark.slow) for key in keys]


@pytest.mark.parametrize("setpoint", core([(10,), (50,), (100,)], (100,)))
def test_mu_reaches_its_cap_14_or_15_steps_after_the_run_away(setpoint):
    """Figure 4: run-away at t = 80 to 90, bifurcation near t = 100, unless an effective value resets μ.

    A run-away starts in [1.2, 0.9 · 1.2 + 1/3], and 1.2 · 1.1¹⁵ > 5 > 1.41 · 1.1¹³.
    """
    run_away, cap, dropped, _ = random_rollouts("siemens", setpoint)
    seen = np.isfinite(cap) & (dropped > cap)
    assert np.count_nonzero(seen) > EPISODES / 2
    assert set(cap[seen] - run_away[seen]) == {14.0, 15.0}


@pytest.mark.parametrize(("variant", "setpoint"), core(RUN_AWAY, ("siemens", 100), ("paper", 10)))
def test_the_table_of_run_aways(variant, setpoint):
    """Why `siemens` is the default: 2,000 episodes of 1000 random steps for each variant and setpoint."""
    median, never, at_cap = RUN_AWAY[variant, setpoint]
    run_away, _, _, share = random_rollouts(variant, setpoint)
    assert abs(np.median(run_away) - median) <= (0.1 * median if variant == "siemens" else 1)
    assert abs(100 * np.mean(np.isinf(run_away)) - never) <= 3
    assert abs(100 * share - at_cap) <= (3 if variant == "siemens" else 1)
