"""The laws and the independence of the random numbers, and the power of the tests.

The noise is recovered from a dataset (float64, `latent: full`) by solving the equations in which it appears,
and is compared with its law and its address. Seeds are fixed, so a test passes always or never. With fresh
seeds, a false alarm at the level ALPHA would come in one of 25,000 runs at most. The power is stated for the
level STRICT, one false alarm in a million, and a deviation of that size is planted to show that the test
finds it. With `IBDATA_TESTS=full`, as in .ci/run, there are a million transitions in place of 100,000.
`IBDATA_EPISODES=1000000` searches for equal episodes among as many as a release does.
"""

from __future__ import annotations

import hashlib
import os
from itertools import combinations

import numpy as np
import pytest
from helpers import FULL
from scipy import stats

from ibdata import Experiment
from ibdata._numerics.random import Purpose, integers, stream_key
from ibdata.dynamics import SIEMENS, Noise
from ibdata.dynamics.fatigue import ALPHA_MEAN, ALPHA_SD, TOLERANCE, bernoulli, squashed_exponential
from ibdata.dynamics.noise import DRIFT_SLOTS, DYNAMICS_SLOTS, NOISE_ROWS, drift_noise, standard_noise
from ibdata.plan.rollout import rollout
from ibdata.views.variables import AMPLIFICATION_START

MILLION = 1_000_000
SETPOINTS, STEPS = tuple(range(10, 101, 10)), 1000
PER_SETPOINT = 100 if FULL else 10
N = len(SETPOINTS) * PER_SETPOINT * STEPS
NORMAL, UNIFORM, EXPONENTIAL = stats.norm(), stats.uniform(), stats.expon()
KURTOSIS = {NORMAL: 3.0, UNIFORM: 1.8, EXPONENTIAL: 9.0}
LAWS = {"act": UNIFORM, "bernoulli": UNIFORM, "uniform": UNIFORM, "exp": EXPONENTIAL, "normal": NORMAL}
ACTIONS = ("act_velocity", "act_gain", "act_shift")
SIDES = {"v": ("latent_mu_v", "latent_effective_velocity"), "g": ("latent_mu_g", "latent_effective_gain")}
COSTS = ("obs_consumption", "latent_expected_consumption")
COLUMNS = (*ACTIONS, *SIDES["v"], *SIDES["g"], "latent_alpha", *COSTS)
LESS = np.sqrt(MILLION / N)  # how much larger a deviation is that N draws show
ALPHA, STRICT, MISS = 1e-6, 2.5e-8, 1e-3
# What a million draws show at STRICT, but with probability MISS.
SHIFT, SCALE, DISTANCE = 0.0087, 0.006, 0.0030
SIGMAS = 5.5  # standard errors that a correlation may have
EPISODES = int(os.environ.get("IBDATA_EPISODES", "100000"))
AT_A_TIME = 10_000
SERIES = (*ACTIONS, *Noise._fields)


def experiment(seed, episodes=PER_SETPOINT, steps=STEPS, **output):
    """Random actions at every setpoint."""
    return Experiment(
        name="quality",
        setpoints=list(SETPOINTS),
        policies=["random"],
        episodes=episodes,
        steps=steps,
        seed=seed,
        output=output,
    )


def recorded(seed):
    """Column → (setpoint, episode, step), of a dataset."""
    whole = experiment(seed, dtype="float64", latent="full")
    parts = []
    for first in range(0, len(SETPOINTS) * PER_SETPOINT, PER_SETPOINT):
        columns = rollout(whole, first, first + PER_SETPOINT)
        parts.append([columns.table[columns.names.index(x)].reshape(PER_SETPOINT, STEPS) for x in COLUMNS])
    return dict(zip(COLUMNS, np.stack(parts, axis=1), strict=True))


def by_address(seed):
    """Noise in standard form → (setpoint, episode, step), from the addresses alone."""
    cells = experiment(seed).cells
    keys = np.repeat([stream_key(seed, cell.digest) for cell in cells], PER_SETPOINT, axis=0)
    indices = np.tile(np.arange(PER_SETPOINT), len(cells))
    rows = np.zeros((NOISE_ROWS, N))
    for purpose, slots, convert in (
        (Purpose.DYNAMICS, DYNAMICS_SLOTS, standard_noise),
        (Purpose.DRIFT, DRIFT_SLOTS, drift_noise),
    ):
        raw = integers(keys, indices, purpose, 0, STEPS, slots)
        convert(np.ascontiguousarray(raw.transpose(1, 2, 0)).reshape(slots, N), rows)
    return {name: x.reshape(len(cells), PER_SETPOINT, STEPS) for name, x in Noise(*rows)._asdict().items()}


def of_consumption(data):
    """The z of c = ĉ + (1 + 0.005 ĉ) z."""
    observed, expected = (data[name] for name in COSTS)
    return (observed - expected) / (1.0 + SIEMENS.consumption_noise * expected)


def of_fatigue(data, addressed, side):
    """The noise of the steps in which μ follows it, with the same steps' noise by address.

    η = 3 (μ_{t+1} - 0.9 μ_t) is its exponential part without an event, and larger with one.
    """
    mu, effective = (data[name] for name in SIDES[side])
    here = (mu[..., :-1] < AMPLIFICATION_START) & (effective[..., 1:] > TOLERANCE)
    eta = 3.0 * (mu[..., 1:] - 0.9 * mu[..., :-1])[here]
    effective = effective[..., 1:][here]
    e, u, b = (addressed[f"{name}_{side}"][..., 1:][here] for name in ("exp", "uniform", "bernoulli"))
    part = np.array([squashed_exponential(x, SIEMENS.eta_mean, *SIEMENS.eta_squash) for x in e.tolist()])
    happened = eta - part > 1e-12
    return {
        "event": (happened, drawn(b, effective)),
        "uniform": (((eta - part) / ((1.0 - part) * effective))[happened], u[happened]),
        "exp": (np.arctanh(eta[~happened]) * 2.0 / SIEMENS.eta_mean, e[~happened]),
    }


def drawn(u, effective):
    """The events that the dynamics make of uniforms u."""
    pairs = zip(u.tolist(), effective.tolist(), strict=True)
    return np.array([bernoulli(*pair, *SIEMENS.bernoulli_bounds) for pair in pairs], dtype=bool)


def law_of(name):
    return LAWS[name.split("_")[0]]


def allowed(alpha):
    """Standard errors that a two-sided test at alpha allows."""
    return stats.norm.isf(alpha / 2)


def critical_distance(n, alpha):
    """The D that n draws exceed with probability at most alpha: Massart's bound, 2 exp(-2 n D²) = alpha."""
    return np.sqrt(np.log(2.0 / alpha) / (2.0 * n))


def passed(x, law, alpha):
    """Whether mean, standard deviation and distribution function of a sample are those of a law."""
    mean = (x.mean() - law.mean()) / law.std() * np.sqrt(x.size)
    ratio = ((x - law.mean()) ** 2).mean() / law.var()
    sd = (ratio - 1.0) / np.sqrt((KURTOSIS[law] - 1.0) / x.size)
    u, steps = law.cdf(np.sort(x, axis=None)), np.arange(x.size + 1) / x.size
    distance = max((steps[1:] - u).max(), (u - steps[:-1]).max())
    return abs(mean) < allowed(alpha), abs(sd) < allowed(alpha), distance < critical_distance(x.size, alpha)


@pytest.fixture(scope="module")
def data():
    return recorded(0)


@pytest.fixture(scope="module")
def addressed():
    return by_address(0)


def test_recovered_noise_is_that_of_its_addresses(data, addressed):
    assert np.abs(of_consumption(data) - addressed["normal_consumption"]).max() < 1e-9
    at_cap = np.maximum(data["latent_mu_v"], data["latent_mu_g"]) >= SIEMENS.alpha_threshold
    alpha = data["latent_alpha"][at_cap]
    z = (np.log(alpha / (1.0 - alpha)) - ALPHA_MEAN) / ALPHA_SD
    assert at_cap.mean() > 0.1
    assert np.abs(z - addressed["normal_alpha"][at_cap]).max() < 1e-9
    for side in SIDES:
        fatigue = of_fatigue(data, addressed, side)
        for name in ("uniform", "exp"):
            found, expected = fatigue[name]
            assert found.size > N // 10
            assert np.abs(found - expected).max() < 1e-9
        np.testing.assert_array_equal(*fatigue["event"])


def test_the_power_is_the_stated_one():
    """A mean off by SHIFT σ or a deviation off by SCALE is missed in one of 1000 samples of a million."""
    needed = allowed(STRICT) + stats.norm.isf(MISS)
    assert round(needed / np.sqrt(MILLION), 4) == SHIFT
    assert round(needed / np.sqrt(2 * MILLION), 3) == SCALE
    assert round(critical_distance(MILLION, STRICT), 4) == DISTANCE


def test_a_deviation_of_the_stated_size_is_refused(addressed):
    z = addressed["normal_consumption"]
    for sign in (-1, 1):
        assert not passed(z + sign * SHIFT * LESS, NORMAL, STRICT)[0]
        assert not passed(z * (1.0 + sign * SCALE * LESS), NORMAL, STRICT)[1]


def series_of(data, addressed):
    """Every variable with mean 0 and variance 1 by its law: (setpoint, episode, step)."""
    whole = {**addressed, **{name: (data[name] + 1.0) / 2.0 for name in ACTIONS}}
    return {name: (x - law_of(name).mean()) / law_of(name).std() for name, x in whole.items()}


@pytest.fixture(scope="module")
def series(data, addressed):
    return series_of(data, addressed)


@pytest.fixture(scope="module")
def other_seed():
    return series_of(recorded(1), by_address(1))


def correlation(x, y):
    """The correlation of two such variables, in standard errors."""
    return abs((x * y).mean()) * np.sqrt(x.size)


@pytest.mark.parametrize("name", SERIES)
def test_a_variable_follows_its_law_and_depends_on_none_of_its_neighbours(series, other_seed, name):
    """Itself in the 20 steps before, in the next episode, the next setpoint, and under another seed."""
    x, other, law = series[name], other_seed[name], law_of(name)
    assert passed(law.mean() + law.std() * x, law, ALPHA) == (True, True, True)
    pairs = [(x[..., lag:], x[..., :-lag]) for lag in range(1, 21)]
    pairs += [(x[:, 1:], x[:, :-1]), (x[1:], x[:-1])]
    pairs += [(x, other), (x[:, 1:], other[:, :-1]), (x[1:], other[:-1])]
    assert max(correlation(*pair) for pair in pairs) < SIGMAS


def test_no_two_variables_of_a_step_or_the_next_are_dependent(series):
    for a, b in combinations(SERIES, 2):
        x, y = series[a], series[b]
        pairs = [(x, y), (x[..., 1:], y[..., :-1]), (x[..., :-1], y[..., 1:])]
        assert max(correlation(*pair) for pair in pairs) < SIGMAS, (a, b)


def digests(episodes):
    """SHA-256 of the float columns of every episode of three steps, and of its actions alone."""
    whole = experiment(0, episodes // len(SETPOINTS), 3)
    for first in range(0, episodes, AT_A_TIME):
        columns = rollout(whole, first, min(first + AT_A_TIME, episodes))
        act = [columns.names.index(name) for name in ACTIONS]
        for episode in columns.table.reshape(len(columns.names), -1, 3).swapaxes(0, 1):
            yield tuple(hashlib.sha256(x.tobytes()).digest() for x in (episode, episode[act]))


@pytest.mark.slow
def test_no_two_of_many_short_episodes_are_equal():
    """And neither are their actions."""
    whole, actions = zip(*digests(EPISODES), strict=True)
    assert len(set(whole)) == len(set(actions)) == EPISODES
