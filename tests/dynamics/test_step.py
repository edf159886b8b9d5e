"""`initial_state` and `step`: shapes, purity, independent lanes, and what a step depends on."""

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
from ibdata.dynamics import PAPER, SIEMENS, Noise, initial_state, step
from ibdata.dynamics.consumption import operational_cost
from ibdata.dynamics.state import FIELDS
from ibdata.views.variables import of_role

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
