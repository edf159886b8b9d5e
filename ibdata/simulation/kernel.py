"""Compiled loops over lanes, which simulate a block of episodes and write its columns."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.dynamics.state import Floats, State
from ibdata.dynamics.step import advance
from ibdata.dynamics.variables import FLOATS
from ibdata.dynamics.variants import Parameters
from ibdata.numerics.compiled import compiled
from ibdata.numerics.philox import Raw
from ibdata.simulation.noise import compiled_blank_noise, drift_noise, standard_noise

Float32s = npt.NDArray[np.float32]
AnyFloats = npt.NDArray[np.floating[Any]]
Ints = npt.NDArray[np.int64]

FLOAT_ROWS = len(FLOATS)


@compiled
def simulate(
    state: State,
    actions: Float32s,
    raw: Raw,
    drift: Raw,
    k: Parameters,
    history: Float32s,
    record: AnyFloats,
    rows: Ints,
    first: int,
) -> None:
    """Advance every lane by several steps, in place.

    Args:
        state: n lanes.
        actions: (steps, n, 3).
        raw: random integers (steps, 8, n).
        drift: random integers (steps, 4, n) for moving setpoints; (0, 4, n) for constant ones.
        k: the parameters of the dynamics.
        history: the latest observations (n, length, 6), newest first; each step adds one.
        record: (variables, times, n), into which the state after step t is written at `first + t`.
        rows: the variables to record, as rows of a state's floats followed by its integers.
        first: see `record`.
    """
    noise = compiled_blank_noise(actions.shape[1])
    for t in range(actions.shape[0]):
        standard_noise(raw[t], noise)
        if drift.shape[0] > 0:
            drift_noise(drift[t], noise)
        advance(state, actions[t], noise, k)
        _observe(state.floats, history)
        for j in range(rows.shape[0]):
            _record(state, rows[j], record[j, first + t])


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
def _record(state: State, row: int, out: AnyFloats) -> None:
    """Write a variable of every lane into out (n,); -0.0 becomes 0.0."""
    if row < FLOAT_ROWS:
        for i in range(out.shape[0]):
            out[i] = state.floats[row, i] + 0.0
    else:
        for i in range(out.shape[0]):
            out[i] = state.integers[row - FLOAT_ROWS, i]


@compiled
def scatter_columns(
    record: AnyFloats,
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
