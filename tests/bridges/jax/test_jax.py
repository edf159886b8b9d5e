"""The simulator in JAX has the equations of `ibdata.dynamics`, and noise of the same laws."""

import shutil

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import ROOT, tape
from helpers.pages import check_guide
from helpers.variants import VARIANTS_MOVED

import ibdata
from ibdata.dynamics import VARIANTS, initial_state

FILE = ROOT / "studies/jax/industrial_benchmark.py"
STEPS, LANES = 400, 60  # of a tape
LATER, MANY = 40, 10_000  # steps and lanes of the comparison of means
variants = pytest.mark.parametrize("variant", VARIANTS)


@pytest.fixture(scope="module")
def ib():
    """The simulator, in float64."""
    jax.config.update("jax_enable_x64", True)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(FILE.parent)
        yield __import__("industrial_benchmark")
    jax.config.update("jax_enable_x64", False)


@pytest.fixture(scope="module")
def play(ib):
    """A function for the states (steps, lanes, …) of a tape; all variants and setpoints share its code."""

    def one(state, action, noise, k):
        new = ib.step_with_noise(state, action, noise, k)
        return new, new

    lanes = jax.vmap(one, in_axes=(0, 0, 0, None))
    return jax.jit(lambda state, inputs, k: jax.lax.scan(lambda x, z: lanes(x, *z, k), state, inputs)[1])


@pytest.fixture(scope="module")
def draw(ib):
    """A function for states (steps, lanes, …): those of a reset and of steps, with a key for each lane."""

    def lane(key, actions, k, moving):
        def one(state, inputs):
            key, action = inputs
            new = ib.step(key, state, action, k)
            return new, new

        first, rest = jax.random.split(key)
        begun = ib.reset(first, k, 70.0, moving=moving)
        _, later = jax.lax.scan(one, begun, (jax.random.split(rest, len(actions)), actions))
        return jax.tree.map(lambda x, y: jnp.append(x[None], y, axis=0), begun, later)

    return jax.jit(jax.vmap(lane, in_axes=(0, None, None, None), out_axes=1))


@variants
@pytest.mark.parametrize("setpoints", ["none", "half", "all"])  # which of them move
def test_it_takes_the_steps_of_ibdata(ib, play, variant, setpoints):
    """On its own from the first step on, so that errors would add up. The tapes reach what is rare."""
    drawn, first = tape.draw(3, STEPS, LANES), tape.start(LANES, setpoints)
    given = first.setpoint, first.velocity, first.gain, first.shift, first.drift_left == 0
    begun = jax.vmap(ib.start)(*given)
    played = play(begun, (drawn.actions, ib.Noise(*drawn.noise)), VARIANTS[variant].parameters)
    expected = tape.stack(tape.play(first, drawn, variant))
    for name in ib.State._fields:
        assert np.array_equal(getattr(begun, name), getattr(first, name)), name
        ours, theirs = getattr(played, name), getattr(expected, name)
        assert ours.shape == theirs.shape
        assert np.all(np.abs(ours - theirs) <= 1e-12 * np.maximum(1.0, np.abs(theirs))), name
    assert set(np.unique(played.direction)) == set(range(-6, 7))
    assert set(np.unique(played.domain)) == set(np.unique(played.response)) == {-1, 1}
    for mu in (played.mu_v, played.mu_g):
        assert (mu < 0.05).any()
        assert (mu == 5.0).any()


@pytest.mark.parametrize("variant", VARIANTS_MOVED.values(), ids=VARIANTS_MOVED)
def test_it_takes_a_step_of_ibdata_where_any_field_of_the_dynamics_is_another(ib, play, variant):
    drawn, first = tape.draw(4, STEPS, LANES), tape.start(LANES, "half")
    states = tape.stack([first, *tape.play(first, drawn, variant)])
    for t in (0, 20, 100):
        one = ib.State(*(getattr(states, name)[t] for name in ib.State._fields))
        found = play(
            one,
            (drawn.actions[t : t + 1], ib.Noise(*(x[t : t + 1] for x in drawn.noise))),
            variant.parameters,
        )
        for name in ib.State._fields:
            ours, theirs = getattr(found, name)[0], getattr(states, name)[t + 1]
            assert np.all(np.abs(ours - theirs) <= 1e-12 * np.maximum(1.0, np.abs(theirs))), name


@variants
@pytest.mark.parametrize("moving", [False, True])
def test_its_noise_has_the_laws_of_ibdata(ib, draw, variant, moving):
    """Means and variances after a reset, 1 step and 40, within five standard errors.

    A mean that is off by 0.09 standard deviations is found in 9 of 10 cases.
    """
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (LATER, 3)).astype(np.float32)
    keys = jax.random.split(jax.random.key(2), MANY)
    drawn = draw(keys, actions, VARIANTS[variant].parameters, moving)
    begin = (variant, initial_state(70.0, drifting=moving))
    for step in (0, 1, LATER):
        given = np.concatenate([np.zeros((1, 3)), actions[:step]])
        expected = ibdata.rollouts(begin, [given], samples=MANY, noise=step).state
        for name in ib.State._fields:
            a = np.reshape(np.asarray(getattr(drawn, name)[step], float), (MANY, -1))
            b = np.reshape(np.asarray(getattr(expected, name), float), (MANY, -1))
            middle = b.mean(0)
            for x, y in ((a, b), ((a - middle) ** 2, (b - middle) ** 2)):
                error = np.sqrt((x.var(0) + y.var(0)) / MANY) + 1e-12 * np.abs(b).max()
                assert np.all(np.abs(x.mean(0) - y.mean(0)) <= 5.0 * error), (name, step)


def test_the_draws_of_a_step_are_not_correlated(ib):
    """Nor those of two keys; within five standard errors."""
    drawn = np.array(jax.vmap(ib.draw)(jax.random.split(jax.random.key(3), MANY + 1)))
    table = np.concatenate([drawn[:, 1:], drawn[:, :-1]])
    assert np.all(np.abs(np.corrcoef(table) - np.eye(24)) <= 5.0 / np.sqrt(MANY))


def test_the_page_prints_what_it_says(tmp_path):
    shutil.copy(FILE, tmp_path)
    check_guide((ROOT / "studies/jax/README.md").read_text(encoding="utf-8"), tmp_path)
