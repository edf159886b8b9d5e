"""The simulator in JAX has the equations of `ibdata.dynamics` and the laws of its noise."""

from functools import partial

import numpy as np
import pytest
from helpers import ROOT, tape

import jax
from ibdata.dynamics import PAPER, SIEMENS

FILE = ROOT / "studies/jax/industrial_benchmark.py"
STEPS, LANES = 400, 60
MANY, SHORT = 10_000, 30  # lanes and steps of the comparison of means
variants = pytest.mark.parametrize("variant", [SIEMENS, PAPER], ids=["siemens", "paper"])


@pytest.fixture(scope="module")
def ib():
    """The simulator, in float64."""
    jax.config.update("jax_enable_x64", True)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(FILE.parent)
        yield __import__("industrial_benchmark")
    jax.config.update("jax_enable_x64", False)


def rows(state, fields):
    """The fields of a state of ibdata's."""
    return [np.asarray(getattr(state, name)) for name in fields]


@variants
@pytest.mark.parametrize("setpoints", ["none", "half", "all"])  # which of them move
def test_it_takes_the_steps_of_ibdata(ib, variant, setpoints):
    """On its own from the first step on, so that errors would add up; the tapes reach every branch."""
    drawn, first = tape.draw(3, STEPS, LANES), tape.start(LANES, setpoints)
    moving = first.drift_left == 0
    before = jax.vmap(ib.start)(first.setpoint, first.velocity, first.gain, first.shift, moving)
    for ours, theirs in zip(before, rows(first, ib.State._fields), strict=True):
        assert np.array_equal(ours, theirs)

    lanes = jax.vmap(partial(ib.step_with_noise, k=variant.parameters))

    def play(state, inputs):
        state = lanes(state, *inputs)
        return state, state

    _, played = jax.jit(partial(jax.lax.scan, play))(before, (drawn.actions, ib.Noise(*drawn.noise)))
    expected = tape.stack(tape.play(first, drawn, variant))
    for name, ours, theirs in zip(ib.State._fields, played, rows(expected, ib.State._fields), strict=True):
        assert ours.shape == theirs.shape, name
        worst = np.max(np.abs(ours - theirs) / np.maximum(1.0, np.abs(theirs)))
        assert worst <= 1e-12, name
        print(name, worst)
    assert set(np.unique(played.direction)) == set(range(-6, 7))
    assert {-1, 1} == set(np.unique(played.domain)) == set(np.unique(played.response))
    assert ((played.mu_v >= 1.2).any(), (played.mu_g >= 1.2).any()) == (True, True)
