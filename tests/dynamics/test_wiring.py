"""Which draws and which past values each part of a step uses."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from helpers import tape

from ibdata.dynamics import PAPER, SIEMENS, Noise
from ibdata.dynamics.fatigue import effective_gain, effective_velocity, noise_component, update_mu
from ibdata.dynamics.miscalibration import effective_shift, penalty, update_direction
from ibdata.dynamics.setpoint import drift
from ibdata.dynamics.state import FIELDS
from ibdata.numerics.exact import logistic

STEPS, LANES = 80, 36
variants = pytest.mark.parametrize("variant", [SIEMENS, PAPER], ids=["siemens", "paper"])

FATIGUE = {"alpha", "fatigue", "reward"}
# A draw of the moving setpoint moves all but the steerings and what follows from them alone.
SETPOINT = set(FIELDS) - {"velocity", "gain", "shift", "basic_fatigue"}
FEEDS = {
    "exp_v": {"mu_v"} | FATIGUE,
    "exp_g": {"mu_g"} | FATIGUE,
    "bernoulli_v": {"mu_v"} | FATIGUE,
    "bernoulli_g": {"mu_g"} | FATIGUE,
    "uniform_v": {"mu_v"} | FATIGUE,
    "uniform_g": {"mu_g"} | FATIGUE,
    "normal_alpha": FATIGUE,
    "normal_consumption": {"consumption", "reward"},
    "uniform_drift_length": SETPOINT,
    "uniform_drift_rate": SETPOINT - {"drift_left"},
    "uniform_drift_zero": SETPOINT - {"drift_left"},
    "uniform_drift_flip": SETPOINT - {"drift_left"},
}


@pytest.fixture(scope="module")
def drawn():
    return tape.draw(23, STEPS, LANES)


@pytest.fixture(scope="module")
def played(drawn):
    """The states of both variants over the tape, the first being the start."""
    start = tape.start(LANES, "half")
    return {v: [start, *tape.play(start, drawn, v)] for v in (SIEMENS, PAPER)}


def lanes(state):
    """The lanes of a state, each with its scalars."""
    return [SimpleNamespace(**{name: getattr(state, name)[i] for name in FIELDS}) for i in range(LANES)]


@variants
@pytest.mark.parametrize("name", Noise._fields)
def test_a_draw_moves_the_listed_outputs_only(drawn, variant, name):
    """Over a tape in which that one draw is made anew at every step; all setpoints move."""
    other = tape.noise(np.random.default_rng(24), STEPS, LANES)
    changed = tape.Tape(drawn.actions, drawn.noise._replace(**{name: getattr(other, name)}))
    runs = [tape.stack(tape.play(tape.start(LANES, "all"), x, variant)) for x in (drawn, changed)]
    assert tape.changed(*runs) == FEEDS[name]


@variants
def test_the_latents_of_the_fatigue_follow_their_own_past_and_their_own_draws(drawn, played, variant):
    k = variant.parameters
    for t, (before, after) in enumerate(zip(played[variant], played[variant][1:], strict=False)):
        noise = tape.at(drawn.noise, t)
        for old, new, u in zip(lanes(before), lanes(after), zip(*noise, strict=True), strict=True):
            n = Noise(*u)
            ve = effective_velocity(new.velocity, new.gain, new.setpoint, k.v0, k.g0, k.v1, k.g1)
            ge = effective_gain(new.gain, new.setpoint)
            eta_v = noise_component(n.exp_v, n.uniform_v, n.bernoulli_v, ve, k)
            eta_g = noise_component(n.exp_g, n.uniform_g, n.bernoulli_g, ge, k)
            assert (new.effective_velocity, new.effective_gain) == (ve, ge)
            assert (new.mu_v, new.mu_g) == (update_mu(old.mu_v, ve, eta_v), update_mu(old.mu_g, ge, eta_g))
            above = max(new.mu_v, new.mu_g) >= variant.alpha_threshold  # the new μ decide
            assert new.alpha == (logistic(2.4 + 0.4 * n.normal_alpha) if above else max(eta_v, eta_g))


@variants
def test_the_mis_calibration_turns_with_the_new_shift_and_is_charged_in_the_new_direction(played, variant):
    for before, after in zip(played[variant], played[variant][1:], strict=False):
        for old, new in zip(lanes(before), lanes(after), strict=True):
            he = effective_shift(new.shift, new.setpoint)
            turned = update_direction(old.domain, old.response, old.direction, he)
            assert (new.domain, new.response, new.direction) == turned
            assert (new.effective_shift, new.penalty) == (he, penalty(new.direction, he))


@variants
def test_a_setpoint_moves_by_its_own_draws_and_only_where_it_moves_at_all(drawn, played, variant):
    for t, (before, after) in enumerate(zip(played[variant], played[variant][1:], strict=False)):
        draws = np.transpose(tape.at(drawn.noise, t)[8:])  # length, rate, zero, flip
        for i, (old, new, u) in enumerate(zip(lanes(before), lanes(after), draws, strict=True)):
            expected = (old.setpoint, old.drift_rate, old.drift_left)
            if i % 2 == 0:
                expected = drift(*expected, *u, variant.parameters)
            assert (new.setpoint, new.drift_rate, new.drift_left) == expected


@variants
def test_the_noise_of_the_consumption_is_scaled_once(drawn, played, variant):
    s, z = tape.stack(played[variant][1:]), drawn.noise.normal_consumption
    spread = 1.0 + variant.consumption_noise * s.expected_consumption
    np.testing.assert_allclose(s.consumption, s.expected_consumption + spread * z, rtol=1e-13, atol=1e-12)
