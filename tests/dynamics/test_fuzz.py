"""Every field of a state stays in its range under any actions."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import tape
from helpers.examples import tries
from hypothesis import given
from hypothesis import strategies as st

from ibdata.dynamics import PAPER, SIEMENS, Noise, initial_state, step
from ibdata.dynamics.miscalibration import SAFE_ZONE
from ibdata.numerics.exact import exponential, normal

SMALLEST, LARGEST = 2.0**-53, 1.0 - 2.0**-53
LANES = 24
ends = st.sampled_from([SMALLEST, 1e-9, 0.0009, 0.0011, 0.5, 0.9989, 0.9991, LARGEST])
uniforms = ends | st.floats(SMALLEST, LARGEST)
actions = st.sampled_from([-1e300, -7.0, -1.0, -0.0, 0.0, 1.0, 7.0, 1e300]) | st.floats(-1.0, 1.0)
percents = st.sampled_from([0.0, 1e-300, 50.0, 100.0]) | st.floats(0.0, 100.0)
variants = pytest.mark.parametrize("variant", [SIEMENS, PAPER], ids=["siemens", "paper"])

RANGES = {
    "setpoint": (0.0, 100.0),
    "velocity": (0.0, 100.0),
    "gain": (0.0, 100.0),
    "shift": (0.0, 100.0),
    "consumption": (-30.0, 5850.0),
    "fatigue": (0.0, 300.0),
    "reward": (-5850.0 - 900.0, 30.0),
    "operational_cost": (1.0, 4914.77),  # e^8.5 = 4914.7688
    "mu_v": (0.0, 5.0),
    "mu_g": (0.0, 5.0),
    "drift_rate": (-1.0, 1.0),
    "convolved_cost": (0.99999 - 1e-12, 4914.77),
    "penalty": (-1.0 - 1e-15, 1.24),
    "expected_consumption": (-24.1, 4914.77 + 25.0 * 2.24),
    "effective_shift": (-1.5, 1.5),
    "effective_velocity": (0.0, 1.0),
    "effective_gain": (0.0, 1.0),
    "alpha": (0.0, 1.0),
    "domain": (-1, 1),
    "response": (-1, 1),
    "direction": (-6, 6),
    "drift_left": (-1, 99),
    "basic_fatigue": (0.0, 300.0),
}


def assert_valid(state, variant):
    for name, (low, high) in RANGES.items():
        field = getattr(state, name)
        assert np.isfinite(field).all(), name
        assert low <= field.min(), name
        assert field.max() <= high, name
    assert (state.drift_left < variant.drift_length).all()
    spread = 1.0 + variant.consumption_noise * state.expected_consumption
    assert (np.abs(state.consumption - state.expected_consumption) <= 8.21 * spread).all()
    assert (state.fatigue <= state.basic_fatigue * (1.0 + 1e-15)).all()
    assert (3.0 * state.fatigue >= state.basic_fatigue * (1.0 - 1e-15)).all()
    for mu, effective in ((state.mu_v, state.effective_velocity), (state.mu_g, state.effective_gain)):
        assert (mu == effective)[effective <= 0.05].all()
    assert (state.response == -1)[np.abs(state.direction) == 6].all()
    home = (state.direction == 0) & (np.abs(state.effective_shift) <= SAFE_ZONE)
    assert (state.domain == 1)[home].all()
    assert (state.response == 1)[home].all()


def assert_followed(before, after):
    """What holds between a state and the next."""
    for name, size in (("setpoint", 1.0), ("velocity", 1.0), ("gain", 10.0), ("shift", 5.7516)):
        assert (np.abs(getattr(after, name) - getattr(before, name)) <= size + 1e-12).all(), name
    assert (np.abs(after.direction - before.direction) <= 1).all()
    still = before.drift_left == -1
    assert (after.setpoint == before.setpoint)[still].all()
    assert (after.drift_left == np.where(still, -1, before.drift_left - 1))[before.drift_left != 0].all()


def noise_of(u):
    """Noise in standard form from an array (12, n) of uniforms."""
    draws = dict(zip(Noise._fields, np.array(u), strict=True))
    for name, x in draws.items():
        if name.startswith("exp"):
            draws[name] = np.array([exponential(y) for y in x])
        if name.startswith("normal"):
            draws[name] = np.array([normal(y) for y in x])
    return Noise(**draws)


@variants
@tries(150)
@given(
    seed=st.integers(0, 2**32),
    walk=st.integers(1, 60),
    starts=st.tuples(percents, percents, percents, percents),
    drifting=st.booleans(),
    action=st.tuples(actions, actions, actions),
    u=st.lists(uniforms, min_size=12, max_size=12),
)
def test_any_step_from_any_state_gives_a_valid_state(variant, seed, walk, starts, drifting, action, u):
    drawn = tape.draw(seed, walk, LANES)
    lanes = [np.full(LANES, x) for x in starts]
    state = tape.play(initial_state(*lanes, drifting=drifting), drawn, variant)[-1]
    assert_valid(state, variant)
    after = step(state, np.tile(action, (LANES, 1)), noise_of(np.tile(np.array(u)[:, None], LANES)), variant)
    assert_valid(after, variant)
    assert_followed(state, after)
