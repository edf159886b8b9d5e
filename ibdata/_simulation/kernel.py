"""Compiled loops over lanes, which simulate a block of episodes and write its columns."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arrays import Float32s, Floats, Ints
from ibdata._numerics.compiled import compiled
from ibdata._numerics.random import Raw
from ibdata.dynamics import variants
from ibdata.dynamics.noise import DYNAMICS_SLOTS, NOISE_ROWS, drift_noise, standard_noise
from ibdata.dynamics.step import advance
from ibdata.policies.distributions import clipped_and_rounded
from ibdata.views.variables import FIRST_WHOLE

AnyFloats = npt.NDArray[np.floating[Any]]


named = compiled(variants.named)  # an array of numbers is faster to pass than a tuple, by 2 µs a call


@compiled
def simulate(
    x: Floats,
    actions: Float32s,
    raw: Raw,
    drift: Raw,
    parameters: Floats,
    observations: Float32s,
    actions_before: Float32s,
    record: Floats,
    rows: Ints,
    first: int,
) -> None:
    """Advance every lane by several steps, in place.

    Args:
        x: the values of a `State` of n lanes.
        actions: (steps, n, 3).
        raw: random integers (steps, 8, n).
        drift: random integers (steps, 4, n) for moving setpoints; no steps for constant ones.
        parameters: the parameters of the dynamics, see `Variant.numbers`.
        observations: the latest ones (n, length, 6), newest first; each step adds one.
        actions_before: the actions that led to them (n, length, 3), newest first; or none (n, 0, 3).
        record: (variables, times, n), into which the state after step t is written at `first + t`.
        rows: the variables to record, as rows of the state.
        first: see `record`.
    """
    noise = np.zeros((NOISE_ROWS, actions.shape[1]))
    k = named(parameters)
    for t in range(actions.shape[0]):
        standard_noise(raw[t], noise)
        if drift.shape[0] > 0:
            drift_noise(drift[t], noise)
        advance(x, actions[t], noise, k)
        _observe(x, observations)
        _remember(actions[t], actions_before)
        for j in range(rows.shape[0]):
            for i in range(x.shape[1]):
                record[j, first + t, i] = x[rows[j], i] + 0.0  # -0.0 becomes 0.0


@compiled
def simulate_lane(
    x: Floats,
    dv: float,
    dg: float,
    dh: float,
    raw: Raw,
    parameters: Floats,
    history: Float32s,
    rows: Ints,
    out: Floats,
) -> None:
    """Advance a single lane by one step, in place, with few arguments: a call takes as long as the equations.

    Args:
        x: the values of a `State` of one lane.
        dv: the action on velocity, a finite number.
        dg: the action on gain.
        dh: the action on shift.
        raw: 8 random integers, and 4 more for a moving setpoint.
        parameters: the parameters of the dynamics, see `Variant.numbers`.
        history: the latest observations (1, length, 6), newest first; the step adds one.
        rows: the variables to read after the step, see `simulate`.
        out: their values; a whole number is written as the bits of an int64.
    """
    action, noise = np.empty((1, 3), dtype=np.float32), np.zeros((NOISE_ROWS, 1))
    action[0, 0], action[0, 1] = clipped_and_rounded(dv), clipped_and_rounded(dg)
    action[0, 2] = clipped_and_rounded(dh)
    column = raw.reshape(raw.shape[0], 1)
    standard_noise(column[:DYNAMICS_SLOTS], noise)
    if raw.shape[0] > DYNAMICS_SLOTS:
        drift_noise(column[DYNAMICS_SLOTS:], noise)
    advance(x, action, noise, named(parameters))
    _observe(x, history)
    whole = out.view(np.int64)
    for j in range(rows.shape[0]):
        if rows[j] < FIRST_WHOLE:
            out[j] = x[rows[j], 0]
        else:
            whole[j] = np.int64(x[rows[j], 0])


@compiled
def _observe(x: Floats, history: Float32s) -> None:
    """Push the observation, the first six rows of x, into a history (n, length, 6); -0.0 becomes 0.0."""
    length = history.shape[1]
    if length == 0:
        return
    for i in range(history.shape[0]):
        for j in range(length - 1, 0, -1):
            for c in range(6):
                history[i, j, c] = history[i, j - 1, c]
        for c in range(6):
            history[i, 0, c] = x[c, i] + 0.0


@compiled
def _remember(actions: Float32s, done: Float32s) -> None:
    """Push actions (n, 3) into those of earlier steps (n, length, 3)."""
    length = done.shape[1]
    if length == 0:
        return
    for i in range(done.shape[0]):
        for j in range(length - 1, 0, -1):
            for c in range(3):
                done[i, j, c] = done[i, j - 1, c]
        for c in range(3):
            done[i, 0, c] = actions[i, c]


@compiled
def scatter_columns(
    record: Floats,
    actions: Float32s,
    log_prob: Floats,
    sources: Ints,
    action_column: int,
    log_prob_column: int,
    table: AnyFloats,
    row: int,
    count: int,
    steps: int,
) -> None:
    """Write some steps of every lane into the columns of a table.

    Args:
        record: (variables, count + 1, n).
        actions: (count, n, 3).
        log_prob: (count, n).
        sources: triples (variable of the record, column, 0 for its value at t or 1 for t + 1).
        action_column: the first of three columns.
        log_prob_column: the column of the log density.
        table: (columns, rows), in which lane i starts at row + i · steps.
        row: see `table`.
        count: the number of steps to write.
        steps: the number of steps of an episode.
    """
    for j in range(sources.shape[0]):
        k, c, later = sources[j, 0], sources[j, 1], sources[j, 2]
        for i in range(actions.shape[1]):
            r0 = row + i * steps
            for t in range(count):
                table[c, r0 + t] = record[k, t + later, i]
    for i in range(actions.shape[1]):
        r0 = row + i * steps
        for j in range(3):
            for t in range(count):
                table[action_column + j, r0 + t] = actions[t, i, j]
        for t in range(count):
            table[log_prob_column, r0 + t] = log_prob[t, i]
