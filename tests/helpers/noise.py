"""The noise of a dataset, solved from the equations in which it appears, and that of its addresses."""

from __future__ import annotations

import numpy as np
from scipy import stats

from helpers.levels import FULL
from ibdata import Experiment
from ibdata.dynamics import SIEMENS, Noise
from ibdata.dynamics.fatigue import AMPLIFICATION_START, TOLERANCE, bernoulli, squashed_exponential
from ibdata.dynamics.noise import (
    DRIFT_SLOTS,
    DYNAMICS_SLOTS,
    NOISE_ROWS,
    drift_noise,
    fields,
    standard_noise,
)
from ibdata.experiment.rollout import rollout
from ibdata.numerics.random import Purpose, integers, stream_key

MILLION = 1_000_000
SETPOINTS, STEPS = tuple(range(10, 101, 10)), 1000
PER_SETPOINT = 100 if FULL else 10
N = len(SETPOINTS) * PER_SETPOINT * STEPS
NORMAL, UNIFORM, EXPONENTIAL = stats.norm(), stats.uniform(), stats.expon()
KURTOSIS = {NORMAL: 3.0, UNIFORM: 1.8, EXPONENTIAL: 9.0}
LAWS = {"act": UNIFORM, "bernoulli": UNIFORM, "uniform": UNIFORM, "exp": EXPONENTIAL, "normal": NORMAL}
ACTIONS = ("act_velocity", "act_gain", "act_shift")
ADDRESSED = Noise._fields
SIDES = {"v": ("latent_mu_v", "latent_effective_velocity"), "g": ("latent_mu_g", "latent_effective_gain")}
COSTS = ("obs_consumption", "latent_expected_consumption")
COLUMNS = (*ACTIONS, *SIDES["v"], *SIDES["g"], "latent_alpha", *COSTS)


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
    return {name: x.reshape(len(cells), PER_SETPOINT, STEPS) for name, x in fields(rows)._asdict().items()}


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
        "effective": effective,
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
