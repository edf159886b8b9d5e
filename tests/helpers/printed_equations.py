"""A second implementation of the printed equations of Hein et al. 2017, with plain numbers and `math` only.

It is written from the paper alone, for one lane, to be read beside the paper and compared with the `paper`
variant. Where the paper is incomplete or has an obvious error, it follows the project's reading: there is a
first step with action zero, "max(μ) = 1.2" means >=, ϱ = +1 if ρˢ = 0, z is given by its formula, and
equation (4) has Δh, not Δs.
"""

from __future__ import annotations

import math

Z = math.sin(math.pi * 15 / 180) / 2
D_H = 20 * math.sin(math.pi * 15 / 180) / 0.9

EPSILON = (1 + math.sqrt(2)) ** (1 / 3) / math.sqrt(3)
ZETA = EPSILON + 1 / (3 * EPSILON)
LAMBDA = 2 * ZETA**2 - ZETA**4 + 8 * math.sqrt(2 / 27) * ZETA
ALPHA = 2 / LAMBDA
BETA = 1 / LAMBDA
KAPPA = -8 * math.sqrt(2 / 27) / LAMBDA


def sgn(x):
    return (x > 0) - (x < 0)


def cube_root(x):
    return math.copysign(abs(x) ** (1 / 3), x)


def logistic(x):
    return 1 / (1 + math.exp(-x))


def start(p, drifting):
    """The state before the first step: velocity, gain and shift at 50, latent variables at their defaults."""
    return {
        "setpoint": p,
        "velocity": 50.0,
        "gain": 50.0,
        "shift": 50.0,
        "operational_cost": None,
        "domain": 1,
        "response": 1,
        "direction": 0,
        "mu_v": 0.0,
        "mu_g": 0.0,
        "drift_rate": 0.0,
        "drift_left": 0 if drifting else -1,
    }


def setpoint(p, b, left, x):
    """Equations (32) and (33), section "Setpoint dynamics", with the draws of length and rate above them."""
    if left == -1:
        return p, b, left
    if left == 0:
        left = 1 + math.floor(100 * x["uniform_drift_length"])
        b = 0.0 if x["uniform_drift_zero"] < 0.1 else x["uniform_drift_rate"]
    if (p == 0 or p == 100) and x["uniform_drift_flip"] < 0.5:
        b = -b
    return max(0.0, min(100.0, p + b)), b, left - 1


def latents_of_miscalibration(delta, psi, phi, he):
    """Equations (9) to (16)."""
    delta_hat = delta if abs(he) <= Z else sgn(he)
    psi_hat = 1 if delta != delta_hat else psi
    if abs(he) <= Z:
        phi_hat = phi - sgn(phi)
    elif phi == -6 * delta_hat:
        phi_hat = phi
    else:
        phi_hat = phi + psi_hat * sgn(he)
    if abs(phi_hat) >= 6:
        psi_hat = -1
        phi = 12 - ((phi_hat + 24) % 24)
    else:
        phi = phi_hat
    if phi == 0 and abs(he) <= Z:
        return 1, 1, phi
    return delta_hat, psi_hat, phi


def radii(rho_s):
    """|r_opt| and |r_min| of appendix B, with guards against rounding at φ = ±3, where the branches meet."""
    varrho = 1 if rho_s == 0 else sgn(rho_s)
    r_opt = varrho * max(abs(rho_s), 2 * Z)
    q = KAPPA * abs(rho_s) / (8 * BETA)
    if q < -math.sqrt(1 / 27):
        u = cube_root(-varrho * q + math.sqrt(max(0.0, q * q - 1 / 27)))
        r_min = u + 1 / (3 * u)
    else:
        r_min = varrho * math.sqrt(4 / 3) * math.cos(math.acos(min(1.0, -q * math.sqrt(27))) / 3)
    return abs(r_opt), abs(r_min)


def miscalibration(phi, he):
    """Equations (17) and (18), with ω from appendix B."""
    rho_s = math.sin(math.pi / 12 * phi)
    r_opt, r_min = radii(rho_s)
    if abs(he) <= r_opt:
        omega = he * r_min / r_opt
    else:
        power = (2 - r_opt) / (2 - r_min)
        omega = sgn(he) * (r_min + (2 - r_min) / (2 - r_opt) ** power * (abs(he) - r_opt) ** power)
    return -ALPHA * omega**2 + BETA * omega**4 + KAPPA * rho_s * omega


def noise_component(e, b, u, effective):
    """Equations (28) and (29), in which e ~ Exp(1) is scaled to the mean 0.05."""
    eta_e = logistic(0.05 * e)
    eta_b = 1 if b < effective else 0
    return eta_e + (1 - eta_e) * u * eta_b * effective


def latent_of_fatigue(mu, effective, eta):
    """Equations (30) and (31)."""
    if effective <= 0.05:
        return effective
    if mu >= 1.2:
        return min(5.0, 1.1 * mu)
    return 0.9 * mu + eta / 3


def step(s, action, x):
    """The state that follows `s` under the action (Δv, Δg, Δh), with draws `x` in standard form, by name."""
    p, b, left = setpoint(s["setpoint"], s["drift_rate"], s["drift_left"], x)

    dv, dg, dh = (max(-1.0, min(1.0, a)) for a in action)
    v = max(0.0, min(100.0, s["velocity"] + 1 * dv))
    g = max(0.0, min(100.0, s["gain"] + 10 * dg))
    h = max(0.0, min(100.0, s["shift"] + D_H * dh))

    theta = math.exp((2 * p + 4 * v + 2.5 * g) / 100)
    thetas = [theta] * 10 if s["operational_cost"] is None else [*s["operational_cost"][1:], theta]
    t = 9  # the newest
    theta_c = (
        thetas[t - 5] / 9
        + 2 * thetas[t - 6] / 9
        + 3 * thetas[t - 7] / 9
        + 2 * thetas[t - 8] / 9
        + thetas[t - 9] / 9
    )

    he = max(-1.5, min(1.5, h / 20 - p / 50 - 1.5))
    delta, psi, phi = latents_of_miscalibration(s["domain"], s["response"], s["direction"], he)
    m = miscalibration(phi, he)
    c_hat = theta_c + 25 * m
    c = c_hat + (1 + 0.02 * c_hat) * x["normal_consumption"]

    t_v, t_v0, t_v1 = (
        (g + p + 2) / (v - p + 101),
        (100 + p + 2) / (0 - p + 101),
        (0 + p + 2) / (100 - p + 101),
    )
    t_g, t_g0, t_g1 = 1 / (g + p + 1), 1 / (100 + p + 1), 1 / (0 + p + 1)
    ve = (t_v - t_v0) / (t_v1 - t_v0)
    ge = (t_g - t_g0) / (t_g1 - t_g0)
    eta_v = noise_component(x["exp_v"], x["bernoulli_v"], x["uniform_v"], ve)
    eta_g = noise_component(x["exp_g"], x["bernoulli_g"], x["uniform_g"], ge)
    mu_v = latent_of_fatigue(s["mu_v"], ve, eta_v)
    mu_g = latent_of_fatigue(s["mu_g"], ge, eta_g)
    alpha = logistic(2.4 + 0.4 * x["normal_alpha"]) if max(mu_v, mu_g) >= 1.2 else max(eta_v, eta_g)
    f_b = max(0.0, 30000 / (5 * v + 100) - 0.01 * g**2)
    f = f_b * (1 + 2 * alpha) / 3

    return {
        "setpoint": p,
        "velocity": v,
        "gain": g,
        "shift": h,
        "consumption": c,
        "fatigue": f,
        "reward": -c - 3 * f,
        "operational_cost": thetas,
        "domain": delta,
        "response": psi,
        "direction": phi,
        "mu_v": mu_v,
        "mu_g": mu_g,
        "drift_rate": b,
        "drift_left": left,
        "convolved_cost": theta_c,
        "penalty": m,
        "expected_consumption": c_hat,
        "effective_shift": he,
        "effective_velocity": ve,
        "effective_gain": ge,
        "alpha": alpha,
        "basic_fatigue": f_b,
    }
