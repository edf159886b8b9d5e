"""The laws and the independence of the random numbers, and the power of the tests.

The noise is recovered from a dataset (float64, `latent: full`) by solving the equations in which it appears,
and is compared with its law and its address. Seeds are fixed, so a test passes always or never. With fresh
seeds, 40 tests at the level ALPHA would raise one false alarm in 25,000 runs. The power is stated for the
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
from helpers.levels import FULL
from scipy import optimize, stats

from ibdata import Experiment
from ibdata.dynamics import SIEMENS, Noise
from ibdata.dynamics.fatigue import (
    ALPHA_MEAN,
    ALPHA_SD,
    AMPLIFICATION_START,
    TOLERANCE,
    bernoulli,
    squashed_exponential,
)
from ibdata.experiment.rollout import rollout
from ibdata.numerics.random import Purpose, integers, stream_key
from ibdata.simulation.noise import (
    DRIFT_SLOTS,
    DYNAMICS_SLOTS,
    NOISE_ROWS,
    drift_noise,
    fields,
    standard_noise,
)

MILLION = 1_000_000
SETPOINTS, STEPS = tuple(range(10, 101, 10)), 1000
PER_SETPOINT = 100 if FULL else 10
N = len(SETPOINTS) * PER_SETPOINT * STEPS
BINS = 20 if N == MILLION else 10
LESS = np.sqrt(MILLION / N)  # how much larger a deviation is that N draws show
ALPHA, STRICT, MISS = 1e-6, 2.5e-8, 1e-3
SHIFT, SCALE, DISTANCE = (
    0.0087,
    0.006,
    0.0030,
)  # seen in a million draws at STRICT; missed with probability MISS
SIGMAS = 5.5  # standard errors that a correlation may have
EPISODES = int(os.environ.get("IBDATA_EPISODES", "100000"))
AT_A_TIME = 10_000

NORMAL, UNIFORM, EXPONENTIAL = stats.norm(), stats.uniform(), stats.expon()
KURTOSIS = {NORMAL: 3.0, UNIFORM: 1.8, EXPONENTIAL: 9.0}
LAWS = {"act": UNIFORM, "bernoulli": UNIFORM, "uniform": UNIFORM, "exp": EXPONENTIAL, "normal": NORMAL}
ACTIONS = ("act_velocity", "act_gain", "act_shift")
ADDRESSED = Noise._fields
RECOVERED = (*ACTIONS, "exp_v", "exp_g", "uniform_v", "uniform_g", "normal_alpha", "normal_consumption")
SERIES = (*ACTIONS, *ADDRESSED)
SIDES = {"v": ("latent_mu_v", "latent_effective_velocity"), "g": ("latent_mu_g", "latent_effective_gain")}
COLUMNS = (
    *ACTIONS,
    *SIDES["v"],
    *SIDES["g"],
    "latent_alpha",
    "obs_consumption",
    "latent_expected_consumption",
)


def law_of(name):
    return LAWS[name.split("_")[0]]


def experiment(seed, episodes=PER_SETPOINT, steps=STEPS, **output):
    return Experiment.model_validate(
        {
            "name": "quality",
            "setpoints": list(SETPOINTS),
            "policies": [{"kind": "random"}],
            "episodes": episodes,
            "steps": steps,
            "seed": seed,
            "output": output,
        }
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
    noise = fields(rows)
    raw = integers(keys, indices, Purpose.DYNAMICS, 0, STEPS, DYNAMICS_SLOTS)
    standard_noise(np.ascontiguousarray(raw.transpose(1, 2, 0)).reshape(DYNAMICS_SLOTS, N), rows)
    raw = integers(keys, indices, Purpose.DRIFT, 0, STEPS, DRIFT_SLOTS)
    drift_noise(np.ascontiguousarray(raw.transpose(1, 2, 0)).reshape(DRIFT_SLOTS, N), rows)
    return {name: x.reshape(len(cells), PER_SETPOINT, STEPS) for name, x in noise._asdict().items()}


def of_consumption(data):
    """The z of c = ĉ + (1 + 0.005 ĉ) z."""
    expected = data["latent_expected_consumption"]
    return (data["obs_consumption"] - expected) / (1.0 + SIEMENS.consumption_noise * expected)


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
        "effective": effective,
    }


def drawn(u, effective):
    """The events that the dynamics make of uniforms u."""
    return np.array(
        [bernoulli(*x, *SIEMENS.bernoulli_bounds) for x in zip(u.tolist(), effective.tolist(), strict=True)],
        dtype=bool,
    )


@pytest.fixture(scope="module")
def data():
    return recorded(0)


@pytest.fixture(scope="module")
def addressed():
    return by_address(0)


@pytest.fixture(scope="module")
def fatigue(data, addressed):
    return {side: of_fatigue(data, addressed, side) for side in SIDES}


@pytest.fixture(scope="module")
def recovered(data, fatigue):
    at_cap = np.maximum(data["latent_mu_v"], data["latent_mu_g"]) >= SIEMENS.alpha_threshold
    alpha = data["latent_alpha"][at_cap]
    return {
        **{name: (data[name] + 1.0) / 2.0 for name in ACTIONS},
        **{f"{name}_{side}": x[name][0] for name in ("exp", "uniform") for side, x in fatigue.items()},
        "normal_alpha": (np.log(alpha / (1.0 - alpha)) - ALPHA_MEAN) / ALPHA_SD,
        "normal_consumption": of_consumption(data),
    }


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


@pytest.mark.parametrize("name", RECOVERED)
def test_noise_recovered_from_a_dataset_follows_its_law(recovered, name):
    assert recovered[name].size > N // 10
    assert passed(recovered[name], law_of(name), ALPHA) == (True, True, True)


@pytest.mark.parametrize("name", ADDRESSED)
def test_noise_taken_from_its_addresses_follows_its_law(addressed, name):
    assert addressed[name].size == N
    assert passed(addressed[name], law_of(name), ALPHA) == (True, True, True)


def test_noise_recovered_from_a_dataset_is_that_of_its_addresses(data, addressed, fatigue):
    assert np.abs(of_consumption(data) - addressed["normal_consumption"]).max() < 1e-9
    for side in SIDES:
        for name in ("uniform", "exp"):
            found, expected = fatigue[side][name]
            assert np.abs(found - expected).max() < 1e-9
        np.testing.assert_array_equal(*fatigue[side]["event"])


def test_the_power_is_the_stated_one():
    """A mean off by SHIFT σ or a deviation off by SCALE is missed in one of 1000 samples of a million."""
    needed = allowed(STRICT) + stats.norm.isf(MISS)
    assert round(needed / np.sqrt(MILLION), 4) == SHIFT
    assert round(needed / np.sqrt(2 * MILLION), 3) == SCALE
    assert round(critical_distance(MILLION, STRICT), 4) == DISTANCE
    assert (round(needed**2), round(needed**2 / 2, 1)) == (75, 37.5)  # N = 75 / shift² and 37.5 / scale²
    assert round(1 / (40 * STRICT)) == 1_000_000


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_mean_or_deviation_that_is_off_by_the_stated_size_is_refused(recovered, sign):
    z = recovered["normal_consumption"]
    assert z.size == N
    assert not passed(z + sign * SHIFT * LESS, NORMAL, STRICT)[0]
    assert not passed(z * (1.0 + sign * SCALE * LESS), NORMAL, STRICT)[1]


def test_a_wrong_shape_with_the_right_mean_and_deviation_is_refused_by_its_distance_alone(recovered):
    """Replacing a share s of the draws by ±1 moves the distribution function by s (½ - Φ(-1)) at ±1."""
    z = recovered["normal_consumption"].ravel().copy()
    margin = stats.norm.isf(MISS) * 0.5 / np.sqrt(N)
    share = (critical_distance(N, STRICT) + margin) / (0.5 - stats.norm.cdf(-1.0))
    assert round(share / LESS, 3) == 0.013
    replaced = z[:: round(1 / share)]
    replaced[:] = np.where(np.arange(replaced.size) % 2, 1.0, -1.0)
    assert passed(z, NORMAL, STRICT) == (True, True, False)


def chi_square(happened, probability):
    """Squared distance of the number of events from that expected in bins; its gain for a lost share²."""
    edges = np.quantile(probability, np.linspace(0, 1, BINS + 1))
    bins = np.digitize(probability, edges[1:-1])
    expected = np.bincount(bins, probability, BINS)
    variance = np.bincount(bins, probability * (1.0 - probability), BINS)
    assert variance.min() > 50  # so many that their number is nearly normal
    return ((np.bincount(bins, happened, BINS) - expected) ** 2 / variance).sum(), (
        expected**2 / variance
    ).sum()


@pytest.mark.parametrize("how", ["recovered", "by address"])
@pytest.mark.parametrize("side", SIDES)
def test_events_have_their_probability_and_a_few_fewer_are_refused(data, addressed, fatigue, side, how):
    if how == "recovered":
        happened, probability = fatigue[side]["event"][0], fatigue[side]["effective"]
    else:
        effective = data[SIDES[side][1]].ravel()
        happened = drawn(addressed[f"bernoulli_{side}"].ravel(), effective)
        probability = np.clip(effective, *SIEMENS.bernoulli_bounds)
    distance, gain = chi_square(happened, probability)
    assert distance < stats.chi2.isf(ALPHA, BINS)

    critical = stats.chi2.isf(STRICT, BINS)
    needed = optimize.brentq(lambda x: stats.ncx2.cdf(critical, BINS, x) - MISS, 1.0, 1000.0)
    share = np.sqrt(needed / gain)
    assert share < 0.02 * LESS
    lost = np.arange(happened.size) * 0.6180339887498949 % 1.0 < share
    assert chi_square(happened & ~lost, probability)[0] > critical


def series_of(data, addressed):
    """Every variable with mean 0 and variance 1 by its law: (setpoint, episode, step)."""
    whole = {**addressed, "normal_consumption": of_consumption(data)}
    whole |= {name: (data[name] + 1.0) / 2.0 for name in ACTIONS}
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
def test_a_variable_does_not_depend_on_itself_in_the_20_steps_before(series, name):
    x = series[name]
    assert max(correlation(x[..., lag:], x[..., :-lag]) for lag in range(1, 21)) < SIGMAS


@pytest.mark.parametrize("name", SERIES)
def test_a_variable_does_not_depend_on_neighbouring_episodes_setpoints_and_seeds(series, other_seed, name):
    x, other = series[name], other_seed[name]
    pairs = [
        (x[:, 1:], x[:, :-1]),
        (x[1:], x[:-1]),
        (x, other),
        (x[:, 1:], other[:, :-1]),
        (x[1:], other[:-1]),
    ]
    assert max(correlation(*pair) for pair in pairs) < SIGMAS


def test_no_two_variables_of_a_step_or_of_neighbouring_steps_depend_on_each_other(series):
    for a, b in combinations(SERIES, 2):
        x, y = series[a], series[b]
        pairs = [(x, y), (x[..., 1:], y[..., :-1]), (x[..., :-1], y[..., 1:])]
        assert max(correlation(*pair) for pair in pairs) < SIGMAS, (a, b)


def test_a_small_dependence_is_refused(series):
    planted = (SIGMAS + stats.norm.isf(MISS)) / np.sqrt(N)
    assert round(planted / LESS, 4) == 0.0086
    before, x = series["normal_consumption"][..., :-1], series["normal_consumption"][..., 1:]
    assert correlation(x + planted * before, before) > SIGMAS


def largest_correlation(x):
    """The largest correlation of any two episodes of (episode, step), in standard errors."""
    r = np.abs(np.corrcoef(x)) * np.sqrt(x.shape[1])
    return r[np.triu_indices(len(x), 1)].max()


@pytest.mark.parametrize("name", [*ACTIONS, "normal_consumption"])
def test_no_two_episodes_are_alike_and_a_stream_used_for_two_is_found(series, name):
    x = series[name].reshape(-1, STEPS).copy()
    bound = allowed(ALPHA / (len(x) * (len(x) - 1) / 2))
    assert largest_correlation(x) < bound
    x[-3] = x[3]
    assert largest_correlation(x) > bound


def repeated_pairs(x):
    """How many pairs of consecutive draws of (episode, step) occur again, to 7 digits, anywhere."""
    digits = np.rint(x * 1e7)
    pairs = (digits[:, :-1] + 1j * digits[:, 1:]).ravel()
    return pairs.size - np.unique(pairs).size


def test_no_run_of_draws_occurs_again_and_a_stream_entered_twice_at_other_steps_is_found(series, other_seed):
    """By chance a pair would occur again with one of 600 seeds."""
    x = np.concatenate([each["normal_consumption"].reshape(-1, STEPS) for each in (series, other_seed)])
    assert repeated_pairs(x) == 0
    x[-3, 100:140] = x[3, 17:57]
    assert repeated_pairs(x) == 39


def digests(episodes):
    """SHA-256 of the float columns of every episode of three steps, and of its actions alone."""
    whole = experiment(0, episodes // len(SETPOINTS), 3)
    for first in range(0, episodes, AT_A_TIME):
        columns = rollout(whole, first, min(first + AT_A_TIME, episodes))
        act = [columns.names.index(name) for name in ACTIONS]
        for episode in columns.table.reshape(len(columns.names), -1, 3).swapaxes(0, 1):
            yield tuple(hashlib.sha256(x.tobytes()).digest() for x in (episode, episode[act]))


def count_duplicates(episodes):
    return len(episodes) - len(set(episodes))


@pytest.mark.slow
def test_no_two_of_many_short_episodes_are_equal_and_neither_are_their_actions():
    whole, actions = zip(*digests(EPISODES), strict=True)
    assert len(whole) == EPISODES
    assert (count_duplicates(whole), count_duplicates(actions)) == (0, 0)
    assert count_duplicates([*whole, whole[EPISODES // 2]]) == 1
