"""Every field of a state stays in its range under any actions."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import tape, tries
from helpers.variants import VARIANTS_MOVED
from hypothesis import given
from hypothesis import strategies as st

from ibdata._numerics.exact import exponential, normal
from ibdata.dynamics import PAPER, SIEMENS, Noise, initial_state, step
from ibdata.views.variables import ROWS, VARIABLES

SMALLEST, LARGEST = 2.0**-53, 1.0 - 2.0**-53
LANES = 24
uniforms = st.sampled_from([SMALLEST, 0.0009, 0.0011, 0.9989, 0.9991, LARGEST]) | st.floats(SMALLEST, LARGEST)
actions = st.sampled_from([-1e300, -7.0, -1.0, -0.0, 0.0, 1.0, 7.0, 1e300]) | st.floats(-1.0, 1.0)
percents = st.sampled_from([0.0, 1e-300, 50.0, 100.0]) | st.floats(0.0, 100.0)
variants = pytest.mark.parametrize("variant", [SIEMENS, PAPER], ids=["siemens", "paper"])


def assert_valid(state, variant):
    """Each number is finite and within the range of the table, and related ones agree."""
    for name, rows in zip(ROWS, state.values, strict=True):
        low, high = VARIABLES[name].low, VARIABLES[name].high
        assert np.isfinite(rows).all(), name
        assert low is None or rows.min() >= low, name
        assert high is None or rows.max() <= high, name
    assert (state.drift_left < variant.drift_length).all()
    spread = 1.0 + variant.consumption_noise * state.expected_consumption
    assert (np.abs(state.consumption - state.expected_consumption) <= 8.21 * np.abs(spread)).all()
    assert (state.fatigue <= state.basic_fatigue * (1.0 + 1e-15)).all()
    assert (3.0 * state.fatigue >= state.basic_fatigue * (1.0 - 1e-15)).all()


def noise_of(u):
    """Noise in standard form from an array (12, n) of uniforms."""
    laws = {"exp": exponential, "normal": normal, "uniform": float, "bernoulli": float}
    rows = zip(Noise._fields, u, strict=True)
    return Noise(*(np.array([laws[name.partition("_")[0]](x) for x in row]) for name, row in rows))


@variants
@tries(60)
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
    assert (np.abs(after.direction - state.direction) <= 1).all()
    assert (np.abs(after.setpoint - state.setpoint) <= 1.0 + 1e-12).all()


@pytest.mark.parametrize("variant", VARIANTS_MOVED.values(), ids=VARIANTS_MOVED)
def test_no_variable_leaves_its_range_where_any_field_is_another(variant):
    for state in tape.play(tape.start(LANES, "half"), tape.draw(5, 100, LANES), variant):
        assert_valid(state, variant)
