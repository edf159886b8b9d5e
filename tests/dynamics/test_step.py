"""`initial_state` and `step`: shapes, purity, independent lanes, and what is refused."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from helpers import ROOT, tape

import ibdata
from ibdata.dynamics import PAPER, SIEMENS, Noise, State, initial_state, step
from ibdata.dynamics.consumption import operational_cost
from ibdata.dynamics.state import FIELDS
from ibdata.views.variables import of_role, rows

STEPS, LANES = 120, 48
variants = pytest.mark.parametrize("variant", [SIEMENS, PAPER], ids=["siemens", "paper"])


@pytest.fixture(scope="module")
def played():
    """The states of both variants over one tape, with every other setpoint moving."""
    drawn = tape.draw(11, STEPS, LANES)
    start = tape.start(LANES, "half")
    return {v: tape.stack([start, *tape.play(start, drawn, v)]) for v in (SIEMENS, PAPER)}


def test_the_initial_state_is_its_steerings_and_nothing_else():
    state = initial_state([10.0, 20.0], gain=30.0, shift=[1.0, 2.0])
    assert state.setpoint.tolist() == [10.0, 20.0]
    assert state.velocity.tolist() == [50.0, 50.0]
    assert state.gain.tolist() == [30.0, 30.0]
    assert state.shift.tolist() == [1.0, 2.0]
    assert state.domain.tolist() == state.response.tolist() == [1, 1]
    assert state.drift_left.tolist() == [-1, -1]
    given = {"setpoint", "velocity", "gain", "shift", "domain", "response", "drift_left"}
    assert not any(getattr(state, name).any() for name in set(FIELDS) - given)
    assert initial_state(50.0, drifting=True).drift_left.tolist() == [0]  # no segment yet
    shared = initial_state(p := np.array([10.0, 20.0]), p, p, p)
    shared.velocity[0] = 99.0
    assert p.tolist() == shared.setpoint.tolist() == shared.gain.tolist() == [10.0, 20.0]


def test_a_whole_step_of_the_authors_system_by_hand():
    """From p = v = g = h = 50 with Δ = (1, -0.5, 0), all exponential draws and both normals 0, no event."""
    zero, late = np.zeros(1), np.full(1, 0.9)
    noise = Noise(*(late if "bernoulli" in name else zero for name in Noise._fields))
    start = step(initial_state(50.0), np.zeros((1, 3)), noise, "siemens")
    state = step(start, [[1.0, -0.5, 0.0]], noise, "siemens")
    assert (state.velocity[0], state.gain[0]) == (51.0, 45.0)
    # η = 2 (σ(0) - ½) = 0, so α = 0 and f = f_b / 3, f_b = 30000/355 - 20.25 = 64.2570423.
    assert state.fatigue[0] == pytest.approx(64.25704225 / 3.0, abs=1e-8)
    # θ = exp((100 + 204 + 112.5)/100) = e^4.165 is not yet seen: θᶜ = 0.99999 e^4.25; m = 0; ĉ = θᶜ + 25.
    assert state.operational_cost[0, 9] == pytest.approx(64.39268, abs=1e-5)
    assert state.consumption[0] == pytest.approx(95.104711, abs=1e-6)
    assert state.reward[0] == pytest.approx(-95.104711 - 64.257042, abs=1e-5)


@variants
def test_a_step_changes_nothing_that_it_was_given(variant):
    rng = np.random.default_rng(5)
    drawn = tape.draw(5, 3, 6)
    state = tape.play(tape.start(6, "half"), drawn, variant)[-1]
    action, noise = rng.uniform(-3.0, 3.0, (6, 3)), tape.noise(rng, 6)
    before = [x.tobytes() for x in (state.values, action, *noise)]
    step(state, action, noise, variant)
    assert [x.tobytes() for x in (state.values, action, *noise)] == before


@variants
def test_the_next_state_depends_on_the_markov_state_only(played, variant):
    """The 20 values of the paper's appendix (θ_t follows from p, v, g), and b and l where the setpoint moves.

    θ[t-9], c and f are among the 20, yet feed nothing: here they are scrambled with all derived values.
    """
    state = tape.take(played[variant], 60)
    rng = np.random.default_rng(8)
    unread = ("consumption", "fatigue", "reward", *of_role("derived"))
    scrambled = {name: rng.random(LANES) for name in unread}
    history = state.operational_cost.copy()
    history[:, 0] = rng.random(LANES)
    history[:, 9] = [
        operational_cost(*x) for x in zip(state.setpoint, state.velocity, state.gain, strict=True)
    ]
    action, noise = rng.uniform(-1.0, 1.0, (LANES, 3)), tape.noise(rng, LANES)
    other = step(state.replace(operational_cost=history, **scrambled), action, noise, variant)
    assert tape.changed(step(state, action, noise, variant), other) == set()


CHILD = """
import sys, numba
from helpers import tape
assert str(numba.config.DISABLE_JIT) == sys.argv[1], numba.config.DISABLE_JIT
print(tape.digest())
"""


def test_the_interpreted_run_has_the_bits_of_the_compiled_one():
    """The child turns the compiler off (or on, where this process has it off) and must find it so."""
    other = "0" if numba.config.DISABLE_JIT else "1"
    path = os.pathsep.join([str(Path(ibdata.__file__).parents[1]), str(ROOT / "tests")])
    env = os.environ | {"NUMBA_DISABLE_JIT": other, "PYTHONPATH": path}
    command = [sys.executable, "-W", "error", "-c", CHILD, other]
    child = subprocess.run(command, env=env, capture_output=True, text=True, timeout=120)
    assert child.returncode == 0, child.stderr
    assert child.stdout.strip() == tape.digest()


INTEGERS = {"domain", "response", "direction", "drift_left"}
NAN, INF = np.nan, np.inf
ZERO = np.zeros((2, 3))
BAD_ACTIONS = [
    (np.zeros(3), r"found shape \(3,\), expected \(2, 3\)"),
    (np.zeros((1, 3)), r"found shape \(1, 3\), expected \(2, 3\)"),
    ([[0.0, 0.0, 0.0], [0.0, NAN, 1.0]], r"found \[ 0. nan  1.\] in lane 1, expected finite"),
    ([[INF, 0.0, 0.0], [0.0, 0.0, 1.0]], r"found \[inf  0.  0.\] in lane 0, expected finite"),
]
BAD_STATES = [
    *((name, NAN) for name in FIELDS if name not in INTEGERS),
    *(("setpoint", -0.1), ("setpoint", 100.1), ("velocity", INF), ("operational_cost", -1.0)),
    *(("domain", 2), ("response", -2), ("direction", 7), ("direction", -(2**63)), ("drift_left", -2)),
    *(("mu_v", -0.1), ("mu_g", 5.1), ("drift_rate", 1e300)),
]
BAD_STARTS = [
    ({"setpoint": 100.5}, r"setpoint: found 100.5, expected numbers in \[0, 100\]"),
    ({"setpoint": NAN}, r"setpoint: found nan, expected numbers in \[0, 100\]"),
    ({"setpoint": 50.0, "gain": [1.0, 101.0]}, r"gain: found \[  1. 101.\], expected numbers in"),
    ({"setpoint": [[50.0]]}, r"setpoint: found shape \(1, 1\), expected a number or \(n,\)"),
    ({"setpoint": [1.0, 2.0], "gain": [1.0, 2.0, 3.0]}, r"found setpoint \(2,\), velocity \(\), gain \(3,\)"),
]


@pytest.fixture
def noise():
    return tape.noise(np.random.default_rng(0), 2)


@pytest.fixture
def state(noise):
    return step(initial_state([20.0, 80.0]), ZERO, noise)


def test_a_start_or_an_action_out_of_range_or_shape_is_refused(state, noise):
    for arguments, message in BAD_STARTS:
        with pytest.raises(ValueError, match=f"^initial_state: {message}"):
            initial_state(**arguments)
    for action, message in BAD_ACTIONS:
        with pytest.raises(ValueError, match=f"^step: action: {message}"):
            step(state, action, noise)


@pytest.mark.parametrize("name", Noise._fields)
def test_noise_of_another_shape_or_law_is_refused(state, noise, name):
    low, high = {"exp": (0.0, 745.2), "normal": (-40.0, 40.0)}.get(name.split("_")[0], (0.0, 1.0 - 2.0**-53))
    outside = ([0.5, np.nextafter(low, -INF)], [0.5, np.nextafter(high, INF)], [0.5, NAN])
    for wrong in ([0.5], [[0.5], [0.5]], *outside):
        message = rf"(?s)^step: noise.{name}: found .*, expected 2 numbers of (Exp|U|N)\("
        with pytest.raises(ValueError, match=message):
            step(state, ZERO, noise._replace(**{name: np.array(wrong)}))
    step(state, ZERO, noise._replace(**{name: np.array([low, high])}))


def test_a_state_out_of_its_range_or_of_another_shape_is_refused(state, noise):
    for name, wrong in BAD_STATES:
        other = State(state.values.copy())
        other.values[rows("theta_0" if name == "operational_cost" else name)[0], 1] = wrong
        with pytest.raises(ValueError, match=rf"(?s)^step: state.{name}: found .*, expected numbers in \["):
            step(other, ZERO, noise)
    with pytest.raises(ValueError, match=r"^step: state: found shape \(31, 2\), expected \(32, lanes\)"):
        step(State(state.values[:-1]), ZERO, noise)
    with pytest.raises(ValueError, match=r"^step: action: found shape \(2, 3\), expected \(1, 3\)"):
        step(State(state.values[:, :1]), ZERO, noise)
