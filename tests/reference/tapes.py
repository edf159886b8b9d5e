"""Tapes for comparisons: actions and noise of many lanes, the states, and the branches that they reach."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numpy as np

from ibdata.dynamics import Noise, initial_state, step
from ibdata.dynamics.state import FIELDS

TOLERANCE = 1e-12  # times max(1, |value|)
STYLES = ("uniform", "saturating", "bang-bang", "slow")


class Tape(NamedTuple):
    """Lanes of equal length. The first step of each has the action zero."""

    setpoint: np.ndarray  # (n,)
    drifting: bool
    action: np.ndarray  # (steps, n, 3)
    noise: Noise  # fields (steps, n)


def make_noise(rng, shape):
    """Noise in standard form, from numpy's own generator.

    A tenth of the uniforms that decide an event are within 0.001 of 0 or 1, where the bounds of its
    probability have an effect.
    """
    draw = {"exp": rng.standard_exponential, "normal": rng.standard_normal}
    noise = Noise(*(draw.get(name.partition("_")[0], rng.random)(shape) for name in Noise._fields))
    for u in (noise.bernoulli_v, noise.bernoulli_g):
        extreme = rng.random(shape) < 0.1
        u[extreme] = np.where(u[extreme] < 0.5, u[extreme] * 0.002, 1.0 - (1.0 - u[extreme]) * 0.002)
    return noise


def make_actions(rng, style, steps):
    """The actions (steps, 3) of one lane. Some are outside [-1, 1], where each implementation clips them."""
    if style == "uniform":
        action = rng.uniform(-1.2, 1.2, (steps, 3))
    elif style == "saturating":  # drives v and g into a corner, another one every 250 steps, and h to an end
        corner = rng.permutation([(-1, 1), (1, -1), (-1, -1), (1, 1)])
        block = np.arange(steps) // 250
        toward = np.column_stack([corner[block % 4], rng.choice([-1, 1], block[-1] + 1)[block]])
        action = (
            toward * rng.uniform(-0.2, 1.2, (steps, 3)) * rng.choice([0.1, 1.0], (steps, 1), p=[0.2, 0.8])
        )
    elif style == "bang-bang":
        flips = rng.random((steps, 3)) < 0.15
        action = np.where(np.cumsum(flips, axis=0) % 2 == 0, 1.0, -1.0)
    else:
        action = rng.normal(0, 0.3, (steps, 3))
    action[0] = 0.0
    return action


def make(setpoints, drifting, steps, seed):
    """A tape with every setpoint in every style of actions: one step with action zero, then `steps` steps."""
    rng = np.random.default_rng(seed)
    setpoint = np.repeat(np.array(setpoints, dtype=np.float64), len(STYLES))
    actions = [make_actions(rng, style, steps + 1) for _ in setpoints for style in STYLES]
    noise = make_noise(rng, (steps + 1, setpoint.size))
    return Tape(setpoint, drifting, np.stack(actions, axis=1), noise)


def run_ibdata(tape, variant):
    """The states of ibdata as a dict of arrays (steps, n, ...). Each step is one call for all lanes."""
    state = initial_state(tape.setpoint, drifting=tape.drifting)
    states = []
    for t in range(tape.action.shape[0]):
        state = step(state, tape.action[t], Noise(*(x[t] for x in tape.noise)), variant)
        states.append(state)
    return {name: np.stack([getattr(s, name) for s in states]) for name in FIELDS}


def transitions(tape):
    """The number of transitions of all lanes, without the step with action zero."""
    return (tape.action.shape[0] - 1) * tape.action.shape[1]


def rows(tape, lane):
    """The noise of one lane as a list with one dict per step, for implementations with one lane."""
    columns = [x[:, lane].tolist() for x in tape.noise]
    return [dict(zip(Noise._fields, row, strict=True)) for row in zip(*columns, strict=True)]


def differences(found, expected):
    """The largest |difference| / max(1, |value|) of each field, except where `expected` is NaN."""
    worst = {}
    for name in FIELDS:
        known = ~np.isnan(expected[name])
        assert known.any(), name
        a, b = found[name][known], expected[name][known]
        scaled = np.abs(a - b) / np.maximum(1.0, np.abs(b))
        worst[name] = float(np.max(scaled))  # NaN, if any, stays
    return worst


def coverage(states, tape, variant):
    """How often the states of a tape take each branch of the dynamics."""
    prev = {name: x[:-1] for name, x in states.items()}
    new = {name: x[1:] for name, x in states.items()}
    count = {f"direction {phi}": new["direction"] == phi for phi in range(-6, 7)}
    for sign in (-1, 1):
        count[f"domain {sign}"] = new["domain"] == sign
        count[f"response {sign}"] = new["response"] == sign
        count[f"effective shift at {1.5 * sign}"] = new["effective_shift"] == 1.5 * sign
    for mu, effective in (("mu_v", "effective_velocity"), ("mu_g", "effective_gain")):
        reset, run_away = new[effective] <= 0.05, prev[mu] >= 1.2
        count[f"{mu} reset"] = reset
        count[f"{mu} reset from a run-away"] = reset & run_away
        count[f"{mu} amplified"] = ~reset & run_away & (new[mu] < 5.0)
        count[f"{mu} at its cap"] = ~reset & run_away & (new[mu] == 5.0)
        count[f"{mu} decays"] = ~reset & ~run_away
        u, e = getattr(tape.noise, f"bernoulli_{mu[-1]}")[1:], new[effective]
        count[f"{effective} event"] = u < e
        count[f"{effective} no event"] = u >= e
        if variant.bernoulli_bounds != (0.0, 1.0):
            low, high = variant.bernoulli_bounds
            count[f"{effective} event by the lower bound"] = (e > 0.0) & (e <= u) & (u < low)
            count[f"{effective} no event by the upper bound"] = (high <= u) & (u < e)
    drawn = np.maximum(new["mu_v"], new["mu_g"]) >= variant.alpha_threshold
    count["alpha drawn anew"] = drawn
    count["alpha from the noise"] = ~drawn
    count["basic fatigue zero"] = new["basic_fatigue"] == 0.0
    count["basic fatigue positive"] = new["basic_fatigue"] > 0.0
    for name, low, high in (("velocity", 0, 100), ("gain", 0, 100), ("shift", 0, 100)):
        count[f"{name} at {low}"] = new[name] == low
        count[f"{name} at {high}"] = new[name] == high
    if tape.drifting:
        in_segment = prev["drift_left"] > 0
        turned = in_segment & (new["drift_rate"] == -prev["drift_rate"]) & (new["drift_rate"] != 0.0)
        where = new["setpoint"] if variant.drift_flip[1] > 0.0 else prev["setpoint"]
        for bound in (0, 100):
            count[f"setpoint reaches {bound}"] = (new["setpoint"] == bound) & (prev["setpoint"] != bound)
            count[f"setpoint flips at {bound}"] = turned & (where == bound)
            count[f"setpoint does not flip at {bound}"] = in_segment & ~turned & (where == bound)
        count["segment drawn"] = prev["drift_left"] == 0
        count["segment with rate zero"] = (prev["drift_left"] == 0) & (new["drift_rate"] == 0.0)
    return {name: int(np.count_nonzero(x)) for name, x in count.items()}


def total_coverage(tapes, variant):
    """The counts of `coverage` over several tapes."""
    total = Counter()
    for tape in tapes:
        total.update(coverage(run_ibdata(tape, variant), tape, variant))
    return total
