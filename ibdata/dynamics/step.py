"""One step of the benchmark for any number of lanes.

The symbols are the paper's, and name the rows of a state: `x[VE, i]` is vᵉ of lane i.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arrays import Floats
from ibdata._numerics.compiled import inlined
from ibdata.dynamics.consumption import (
    consumption,
    convolved_cost,
    expected_consumption,
    operational_cost,
    remember,
    reward,
)
from ibdata.dynamics.fatigue import (
    amplification,
    basic_fatigue,
    effective_gain,
    effective_velocity,
    fatigue,
    noise_component,
    update_mu,
)
from ibdata.dynamics.miscalibration import effective_shift, penalty, update_direction
from ibdata.dynamics.noise import NOISE_ROWS, Noise, checked_noise
from ibdata.dynamics.setpoint import D_G, D_H, D_V, drift, steer
from ibdata.dynamics.state import NO_DRIFT, THETAS, State, checked_state
from ibdata.dynamics.variants import Parameters, Variant, resolve
from ibdata.views.variables import rows

P, V, G, H = rows("setpoint", "velocity", "gain", "shift")
F, C, R = rows("fatigue", "consumption", "reward")
B, L = rows("drift_rate", "drift_left")
VE, GE, MU_V, MU_G = rows("effective_velocity", "effective_gain", "mu_v", "mu_g")
ALPHA, FB = rows("alpha", "basic_fatigue")
HE, DELTA, PSI, PHI = rows("effective_shift", "domain", "response", "direction")
THETA_C, M, C_HAT = rows("convolved_cost", "penalty", "expected_consumption")
# The rows of a table of noise, in the order of `Noise`.
(
    EXP_V, EXP_G, BERNOULLI_V, BERNOULLI_G, UNIFORM_V, UNIFORM_G, NORMAL_ALPHA, NORMAL_C,
    DRIFT_LENGTH, DRIFT_RATE, DRIFT_ZERO, DRIFT_FLIP,
) = range(NOISE_ROWS)  # fmt: skip
ETA_V, ETA_G = EXP_V, EXP_G  # each η takes the place of a draw


def step(state: State, action: npt.ArrayLike, noise: Noise, variant: Variant | str = "siemens") -> State:
    """The state one step later. The arguments are not changed.

    The parts are computed in the order of the authors' `IDS.step`, because the paper gives none: setpoint,
    steering, fatigue, operational cost, mis-calibration, consumption, reward.

    Args:
        state: n lanes.
        action: (n, 3) = (Δv, Δg, Δh), clipped to [-1, 1].
        noise: the random numbers of the step, in standard form.
        variant: the dynamics, as a `Variant` or by the name of a published one.

    Returns:
        A state that shares no memory with the one given.

    Raises:
        ValueError: state, action or noise is not finite, out of range, or of the wrong length.
    """
    new = checked_state(state, resolve(variant))
    actions = np.array(action, dtype=np.float64)
    if actions.shape != (new.lanes, 3):
        raise ValueError(f"step: action: found shape {actions.shape}, expected ({new.lanes}, 3)")
    finite = np.isfinite(actions).all(axis=1)
    if not finite.all():
        lane = int(np.argmin(finite))
        raise ValueError(f"step: action: found {actions[lane]} in lane {lane}, expected finite numbers")
    advance(new.values, actions, checked_noise(noise, new.lanes), resolve(variant).parameters)
    return new


@inlined
def advance(x: Floats, action: npt.NDArray[np.floating[Any]], z: Floats, k: Parameters) -> None:
    """Advance every lane by one step, in place: the compiled part of `step`, without its checks.

    Each equation has a loop of its own, so that the loops without branches are vectorized. They name the
    rows of the state by number: numba counts references to views of rows, which takes as long as the
    equations of one lane. The noise (12, n), z, is overwritten.
    """
    _steer(x, action, z, k)
    _update_fatigue(x, z, k)
    _update_consumption(x, z, k)


@inlined
def _steer(x: Floats, action: npt.NDArray[np.floating[Any]], z: Floats, k: Parameters) -> None:
    """Setpoint, velocity, gain and shift."""
    n = x.shape[1]
    for i in range(n):
        if x[L, i] != NO_DRIFT:
            x[P, i], x[B, i], x[L, i] = drift(
                x[P, i],
                x[B, i],
                int(x[L, i]),
                z[DRIFT_LENGTH, i],
                z[DRIFT_RATE, i],
                z[DRIFT_ZERO, i],
                z[DRIFT_FLIP, i],
                k,
            )
    for i in range(n):
        x[V, i] = steer(x[V, i], D_V, np.float64(action[i, 0]))
    for i in range(n):
        x[G, i] = steer(x[G, i], D_G, np.float64(action[i, 1]))
    for i in range(n):
        x[H, i] = steer(x[H, i], D_H, np.float64(action[i, 2]))


@inlined
def _update_fatigue(x: Floats, z: Floats, k: Parameters) -> None:
    """Effective velocity and gain, their noise, the hidden μ, and fatigue."""
    n = x.shape[1]
    for i in range(n):
        x[VE, i] = effective_velocity(x[V, i], x[G, i], x[P, i], k.effective_velocity_ends)
    for i in range(n):
        x[GE, i] = effective_gain(x[G, i], x[P, i])
    for i in range(n):
        z[ETA_V, i] = noise_component(z[EXP_V, i], z[UNIFORM_V, i], z[BERNOULLI_V, i], x[VE, i], k)
    for i in range(n):
        z[ETA_G, i] = noise_component(z[EXP_G, i], z[UNIFORM_G, i], z[BERNOULLI_G, i], x[GE, i], k)
    for i in range(n):
        x[MU_V, i] = update_mu(x[MU_V, i], x[VE, i], z[ETA_V, i])
    for i in range(n):
        x[MU_G, i] = update_mu(x[MU_G, i], x[GE, i], z[ETA_G, i])
    for i in range(n):
        x[ALPHA, i] = amplification(
            x[MU_V, i], x[MU_G, i], z[ETA_V, i], z[ETA_G, i], z[NORMAL_ALPHA, i], k.alpha_threshold
        )
    for i in range(n):
        x[FB, i] = basic_fatigue(x[V, i], x[G, i])
    for i in range(n):
        x[F, i] = fatigue(x[FB, i], x[ALPHA, i])


@inlined
def _update_consumption(x: Floats, z: Floats, k: Parameters) -> None:
    """Operational cost, mis-calibration, consumption and reward."""
    n = x.shape[1]
    costs, theta = x[THETAS], x[THETA_C]  # θ is in the place of θᶜ until that is known
    for i in range(n):
        theta[i] = operational_cost(x[P, i], x[V, i], x[G, i])
    remember(theta, costs)
    for i in range(n):
        x[THETA_C, i] = convolved_cost(costs, i, k.convolution_weights)
    for i in range(n):
        x[HE, i] = effective_shift(x[H, i], x[P, i])
    for i in range(n):
        x[DELTA, i], x[PSI, i], x[PHI, i] = update_direction(
            int(x[DELTA, i]), int(x[PSI, i]), int(x[PHI, i]), x[HE, i]
        )
    for i in range(n):
        x[M, i] = penalty(int(x[PHI, i]), x[HE, i])
    for i in range(n):
        x[C_HAT, i] = expected_consumption(x[THETA_C, i], x[M, i], k.consumption_offset)
    for i in range(n):
        x[C, i] = consumption(x[C_HAT, i], z[NORMAL_C, i], k.consumption_noise)
    for i in range(n):
        x[R, i] = reward(x[C, i], x[F, i])
