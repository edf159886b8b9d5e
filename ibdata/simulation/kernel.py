"""Compiled loops over lanes: what a block of episodes does at every step, and its columns afterwards."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.dynamics.state import Floats, Noise, State
from ibdata.dynamics.step import advance
from ibdata.dynamics.variants import Parameters
from ibdata.numerics.compiled import compiled
from ibdata.numerics.philox import Raw
from ibdata.simulation.noise import compiled_blank_noise, drift_noise, standard_noise
from ibdata.simulation.packed import Packed, unpacked

Float32s = npt.NDArray[np.float32]
AnyFloats = npt.NDArray[np.floating[Any]]
Ints = npt.NDArray[np.int64]


@compiled
def step_lanes(
    state: State, action: Float32s, raw: Raw, drift: Raw, t: int, noise: Noise, k: Parameters
) -> None:
    """One step in place with the integers (8, n) and (4, n) of step t.

    drift has no steps for constant setpoints.
    """
    standard_noise(raw[t], noise)
    if drift.shape[0] > 0:
        drift_noise(drift[t], noise)
    advance(state, action, noise, k)


@compiled
def observe(state: State, history: Float32s, first: bool) -> None:
    """Push the observation into a history (n, frames, 6), newest first; at first into every frame."""
    frames = history.shape[1]
    if frames == 0:
        return
    for i in range(history.shape[0]):
        for j in range(frames - 1, 0, -1):
            for c in range(6):
                history[i, j, c] = history[i, j - 1, c]
        history[i, 0, 0] = state.setpoint[i] + 0.0
        history[i, 0, 1] = state.velocity[i] + 0.0
        history[i, 0, 2] = state.gain[i] + 0.0
        history[i, 0, 3] = state.shift[i] + 0.0
        history[i, 0, 4] = state.fatigue[i] + 0.0
        history[i, 0, 5] = state.consumption[i] + 0.0
        if first:
            for j in range(1, frames):
                for c in range(6):
                    history[i, j, c] = history[i, 0, c]


@compiled
def record_state(state: State, out: AnyFloats, drifting: bool) -> None:
    """The variables of a state into out (n, variables), as many as it has room for; -0.0 becomes 0.0.

    Order: observation, reward, latents, moving setpoint (if drifting), derived values.
    """
    for i in range(out.shape[0]):
        out[i, 0] = state.setpoint[i] + 0.0
        out[i, 1] = state.velocity[i] + 0.0
        out[i, 2] = state.gain[i] + 0.0
        out[i, 3] = state.shift[i] + 0.0
        out[i, 4] = state.fatigue[i] + 0.0
        out[i, 5] = state.consumption[i] + 0.0
        out[i, 6] = state.reward[i] + 0.0
        if out.shape[1] == 7:
            continue
        for lag in range(9):
            out[i, 7 + lag] = state.operational_cost[i, 8 - lag]
        out[i, 16] = state.domain[i]
        out[i, 17] = state.response[i]
        out[i, 18] = state.direction[i]
        out[i, 19] = state.mu_v[i] + 0.0
        out[i, 20] = state.mu_g[i] + 0.0
        j = 21
        if drifting:
            out[i, 21] = state.drift_rate[i] + 0.0
            out[i, 22] = state.drift_left[i]
            j = 23
        if out.shape[1] > j:
            out[i, j] = state.convolved_cost[i] + 0.0
            out[i, j + 1] = state.penalty[i] + 0.0
            out[i, j + 2] = state.expected_consumption[i] + 0.0
            out[i, j + 3] = state.effective_shift[i] + 0.0
            out[i, j + 4] = state.effective_velocity[i] + 0.0
            out[i, j + 5] = state.effective_gain[i] + 0.0
            out[i, j + 6] = state.alpha[i] + 0.0
            out[i, j + 7] = state.basic_fatigue[i] + 0.0


@compiled
def simulate(
    packed: Packed,
    actions: Float32s,
    raw: Raw,
    drift: Raw,
    k: Parameters,
    history: Float32s,
    record: AnyFloats,
    drifting: bool,
) -> None:
    """Steps of every lane in place with actions (steps, n, 3), and what is seen and kept of each.

    The record (steps, n, variables) holds the state after each step, the history what a policy sees last.
    """
    state = unpacked(packed)
    noise = compiled_blank_noise(actions.shape[1])
    for t in range(actions.shape[0]):
        step_lanes(state, actions[t], raw, drift, t, noise, k)
        observe(state, history, False)
        record_state(state, record[t], drifting)


TILE = 16


@compiled
def scatter_columns(
    record: AnyFloats,
    actions: Float32s,
    log_prob: Floats,
    at_t: Ints,
    at_t_plus_1: Ints,
    action_column: int,
    log_prob_column: int,
    table: AnyFloats,
    row: int,
    count: int,
    steps: int,
) -> None:
    """A chunk (step, lane, variable) into the columns of table (columns, rows).

    Lane i starts at row + i · steps; `now` and `after` are pairs (variable, column) taken at t and t + 1.
    """
    for i in range(record.shape[1]):
        r0 = row + i * steps
        for t0 in range(0, count, TILE):
            t1 = min(count, t0 + TILE)
            for j in range(at_t.shape[0]):
                k, c = at_t[j, 0], at_t[j, 1]
                for t in range(t0, t1):
                    table[c, r0 + t] = record[t, i, k]
            for j in range(at_t_plus_1.shape[0]):
                k, c = at_t_plus_1[j, 0], at_t_plus_1[j, 1]
                for t in range(t0, t1):
                    table[c, r0 + t] = record[t + 1, i, k]
            for j in range(3):
                for t in range(t0, t1):
                    table[action_column + j, r0 + t] = actions[t, i, j]
            for t in range(t0, t1):
                table[log_prob_column, r0 + t] = log_prob[t, i]
