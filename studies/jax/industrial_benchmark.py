"""The Industrial Benchmark in JAX: pure functions of one lane, for `jax.jit`, `jax.vmap` and `jax.lax.scan`.

    k = ibdata.dynamics.SIEMENS.parameters
    state = reset(key, k, setpoint=70.0)
    state = step(key, state, action, k)  # its reward is state.reward

The equations are those of Hein et al. 2017, a function each, written anew: of ibdata this file needs only the
numbers of a `Variant`. Names are those of `ibdata.dynamics`. Numbers are float32, or float64 with
`jax_enable_x64`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

if TYPE_CHECKING:
    from ibdata.dynamics.variants import Parameters

CONSTANT = -1  # the steps left of a setpoint that does not move
SIN_15 = float(np.sin(np.pi / 12))
SAFE_ZONE = SIN_15 / 2  # half of the width; the paper prints 0.1309


class State(NamedTuple):
    """The Markov state of a lane, with the observed f and c, and the reward."""

    setpoint: jax.Array
    velocity: jax.Array
    gain: jax.Array
    shift: jax.Array
    fatigue: jax.Array
    consumption: jax.Array
    reward: jax.Array
    operational_cost: jax.Array  # (10,), θ[t-9] … θ[t]; zeros before the first step
    domain: jax.Array
    response: jax.Array
    direction: jax.Array
    mu_v: jax.Array
    mu_g: jax.Array
    drift_rate: jax.Array
    drift_left: jax.Array


class Noise(NamedTuple):
    """The random numbers of a step, in standard form, in the order of `ibdata.dynamics.Noise`."""

    exp_v: jax.Array  # Exp(1)
    exp_g: jax.Array
    bernoulli_v: jax.Array  # U(0, 1); the event is u < p
    bernoulli_g: jax.Array
    uniform_v: jax.Array  # U(0, 1)
    uniform_g: jax.Array
    normal_alpha: jax.Array  # N(0, 1)
    normal_consumption: jax.Array
    uniform_drift_length: jax.Array  # U(0, 1); used by moving setpoints only
    uniform_drift_rate: jax.Array
    uniform_drift_zero: jax.Array
    uniform_drift_flip: jax.Array


def start(setpoint, velocity=50.0, gain=50.0, shift=50.0, moving=False) -> State:
    """The state before the first step, whose action is zero. The numbers are in [0, 100]."""
    steerings = [jnp.asarray(x, float) for x in (setpoint, velocity, gain, shift)]
    zero, one, none = jnp.zeros((), float), jnp.int32(1), jnp.int32(0)
    left = jnp.where(moving, none, jnp.int32(CONSTANT))
    return State(*steerings, zero, zero, zero, jnp.zeros(10, float), one, one, none, zero, zero, zero, left)


def reset(key, k: Parameters, setpoint, velocity=50.0, gain=50.0, shift=50.0, moving=False) -> State:
    """The state of the first observation. A moving setpoint starts where a constant one stays."""
    return step(key, start(setpoint, velocity, gain, shift, moving), jnp.zeros(3), k)


def step(key, state: State, action, k: Parameters) -> State:
    """The state one step later, with the noise of a key."""
    return step_with_noise(state, action, draw(key), k)


def observation(state: State) -> jax.Array:
    """What an agent sees (6,): setpoint, velocity, gain, shift, fatigue and consumption."""
    return jnp.stack(state[:6])


def draw(key) -> Noise:
    """The noise of a step."""
    exponential, uniform, normal = jax.random.split(key, 3)
    u = jax.random.uniform(uniform, (8,))
    return Noise(*jax.random.exponential(exponential, (2,)), *u[:4], *jax.random.normal(normal, (2,)), *u[4:])


def step_with_noise(state: State, action, z: Noise, k: Parameters) -> State:
    """The state one step later under an action (3,) = (Δv, Δg, Δh), with the noise z."""
    action = jnp.asarray(action, float)
    p, b, left = drift(state.setpoint, state.drift_rate, state.drift_left, z, k)
    v = steer(state.velocity, 1.0, action[0])
    g = steer(state.gain, 10.0, action[1])
    h = steer(state.shift, 20.0 * SIN_15 / 0.9, action[2])

    ve = effective_velocity(v, g, p, k)
    ge = effective_gain(g, p)
    eta_v = noise_component(z.exp_v, z.bernoulli_v, z.uniform_v, ve, k)
    eta_g = noise_component(z.exp_g, z.bernoulli_g, z.uniform_g, ge, k)
    mu_v = next_mu(state.mu_v, ve, eta_v)
    mu_g = next_mu(state.mu_g, ge, eta_g)
    alpha = amplification(mu_v, mu_g, eta_v, eta_g, z.normal_alpha, k)
    f = fatigue(basic_fatigue(v, g), alpha)

    theta = remembered(state.operational_cost, operational_cost(p, v, g))
    he = effective_shift(h, p)
    delta, psi, phi = next_direction(state.domain, state.response, state.direction, he)
    c_hat = expected_consumption(convolved_cost(theta, k), penalty(phi, he), k)
    c = consumption(c_hat, z.normal_consumption, k)
    return State(
        p, v, g, h, f, c, -c - 3.0 * f, theta, delta, psi, phi, mu_v, mu_g, b, left
    )  # reward: Eq. (5)


def drift(p, b, left, z: Noise, k: Parameters):
    """Eqs. (32), (33) and above them: setpoint, its rate, and the steps left of its segment."""
    moving, ended = left != CONSTANT, left == 0
    (slowest, fastest), (flip_before, flip_after) = k.drift_rate, k.drift_flip
    length = 1 + jnp.floor(k.drift_length * z.uniform_drift_length).astype(jnp.int32)
    drawn = slowest + (fastest - slowest) * z.uniform_drift_rate
    rate = jnp.where(ended, jnp.where(z.uniform_drift_zero < 0.1, 0.0, drawn), b)
    at_bound = (p == 0.0) | (p == 100.0)  # the paper's flip, before the setpoint moves
    rate = jnp.where(at_bound & (z.uniform_drift_flip < flip_before), -rate, rate)
    past_bound = (p + rate < 0.0) | (p + rate > 100.0)  # that of the authors' code, after it
    after = jnp.where(past_bound & (z.uniform_drift_flip < flip_after), -rate, rate)
    moved = jnp.clip(p + rate, 0.0, 100.0), after, jnp.where(ended, length, left) - 1
    return tuple(jnp.where(moving, new, old) for new, old in zip(moved, (p, b, left), strict=True))


def steer(x, d, change):
    """Eqs. (2), (3), (4): velocity, gain or shift after a change, which is clipped to [-1, 1]."""
    return jnp.clip(x + d * jnp.clip(change, -1.0, 1.0), 0.0, 100.0)


def effective_velocity(v, g, p, k: Parameters):
    """Eqs. (24) and (26)."""

    def transform(v, g):
        return (g + p + 2.0) / (v - p + 101.0)

    t0, t1 = (transform(*end) for end in k.effective_velocity_ends)
    return (transform(v, g) - t0) / (t1 - t0)


def effective_gain(g, p):
    """Eqs. (25) and (27)."""

    def transform(g):
        return 1.0 / (g + p + 1.0)

    return (transform(g) - transform(100.0)) / (transform(0.0) - transform(100.0))


def noise_component(e, u_event, u, effective, k: Parameters):
    """Eqs. (28) and (29), η = ηᵉ + (1 - ηᵉ) ηᵘ ηᵇ · effective, and the laws of ηᵉ and ηᵇ above them."""
    scale, shift = k.eta_squash
    eta_e = scale * (jax.nn.sigmoid(k.eta_mean * e) - shift)
    event = u_event < jnp.clip(effective, *k.bernoulli_bounds)
    return eta_e + (1.0 - eta_e) * u * event * effective


def next_mu(mu, effective, eta):
    """Eqs. (30) and (31)."""
    grown = jnp.where(mu >= 1.2, jnp.minimum(5.0, 1.1 * mu), 0.9 * mu + eta / 3.0)
    return jnp.where(effective <= 0.05, effective, grown)


def amplification(mu_v, mu_g, eta_v, eta_g, z, k: Parameters):
    """Eq. (23)."""
    bifurcated = jnp.maximum(mu_v, mu_g) >= k.alpha_threshold
    return jnp.where(bifurcated, jax.nn.sigmoid(2.4 + 0.4 * z), jnp.maximum(eta_v, eta_g))


def basic_fatigue(v, g):
    """Eq. (21)."""
    return jnp.maximum(0.0, 30000.0 / (5.0 * v + 100.0) - 0.01 * g * g)


def fatigue(f_b, alpha):
    """Eq. (22)."""
    return f_b * (1.0 + 2.0 * alpha) / 3.0


def operational_cost(p, v, g):
    """Eq. (6)."""
    return jnp.exp((2.0 * p + 4.0 * v + 2.5 * g) / 100.0)


def remembered(history, theta):
    """The last ten operational costs, oldest first. The first fills the history, as in the authors' code."""
    return jnp.where(history[-1] == 0.0, theta, jnp.append(history[1:], theta))


def convolved_cost(theta, k: Parameters):
    """Eq. (7), with the weights of lags 5 to 9."""
    return sum(weight * theta[-1 - lag] for lag, weight in enumerate(k.convolution_weights, start=5))


def effective_shift(h, p):
    """Eq. (8)."""
    return jnp.clip(h / 20.0 - p / 50.0 - 1.5, -1.5, 1.5)


def next_direction(delta, psi, phi, he):
    """Eqs. (9) to (16): domain δ, response ψ and direction φ."""
    safe, sign = jnp.abs(he) <= SAFE_ZONE, jnp.sign(he).astype(jnp.int32)
    delta_hat = jnp.where(safe, delta, sign)  # (9)
    psi_hat = jnp.where(delta != delta_hat, 1, psi)  # (10)
    turn = jnp.where(phi == -6 * delta_hat, 0, psi_hat * sign)  # (12)
    phi_hat = phi + jnp.where(safe, -jnp.sign(phi), turn)  # (11)
    outside = jnp.abs(phi_hat) >= 6
    psi_next = jnp.where(outside, -1, psi_hat)  # (13)
    phi_next = jnp.where(outside, 12 - (phi_hat + 24) % 24, phi_hat)  # (14)
    home = safe & (phi_next == 0)
    return jnp.where(home, 1, delta_hat), jnp.where(home, 1, psi_next), phi_next  # (15), (16)


# Eqs. (34) to (39): the constants of the Goldstone potential.
EPSILON = float(np.cbrt(1 + np.sqrt(2)) / np.sqrt(3))
ZETA = EPSILON + 1 / (3 * EPSILON)
LAMBDA = float(2 * ZETA**2 - ZETA**4 + 8 * np.sqrt(2 / 27) * ZETA)
ALPHA, BETA, KAPPA = 2 / LAMBDA, 1 / LAMBDA, float(-8 * np.sqrt(2 / 27) / LAMBDA)


def radii(phi: int) -> tuple[float, float, float]:
    """ρˢ, |r_opt| and |r_min| of a direction, by Eqs. (18) and (43) to (47)."""
    rho_s = abs(np.sin(np.pi * phi / 12))
    q = KAPPA * rho_s / (8 * BETA)
    if abs(phi) > 3:  # q < -√(1/27); at 3 both branches are 2/√3
        u = np.cbrt(-q + np.sqrt(q * q - 1 / 27))
        r_min = u + 1 / (3 * u)
    else:
        r_min = np.sqrt(4 / 3) * np.cos(np.arccos(min(1.0, -q * np.sqrt(27))) / 3)
    return np.sign(phi) * rho_s, max(rho_s, 2 * SAFE_ZONE), r_min


RADII = np.array([radii(phi) for phi in range(-6, 7)])


def radius(he, r_opt, r_min):
    """Eqs. (40) to (42): ω, which is ±|r_min| at hᵉ = ±|r_opt|."""
    power = (2.0 - r_opt) / (2.0 - r_min)
    beyond = jnp.maximum(0.0, jnp.abs(he) - r_opt) / (2.0 - r_opt)
    outer = jnp.sign(he) * (r_min + (2.0 - r_min) * beyond**power)
    return jnp.where(jnp.abs(he) <= r_opt, he * r_min / r_opt, outer)


def penalty(phi, he):
    """Eq. (17): m = -α ω² + β ω⁴ + κ ρˢ ω."""
    rho_s, r_opt, r_min = jnp.asarray(RADII, he.dtype)[phi + 6]
    w = radius(he, r_opt, r_min)
    return -ALPHA * w**2 + BETA * w**4 + KAPPA * rho_s * w


def expected_consumption(theta_c, m, k: Parameters):
    """Eq. (19)."""
    return theta_c + 25.0 * (m + k.consumption_offset)


def consumption(c_hat, z, k: Parameters):
    """Eq. (20)."""
    return c_hat + (1.0 + k.consumption_noise * c_hat) * z
