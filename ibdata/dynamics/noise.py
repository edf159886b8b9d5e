"""The noise of one step: how random integers become it, and the law of the next fatigue and consumption."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ibdata._numerics.arrays import Floats
from ibdata._numerics.compiled import compiled
from ibdata._numerics.exact import exponential, normals
from ibdata._numerics.random import Raw, uniform
from ibdata.dynamics.fatigue import ALPHA_MEAN, ALPHA_SD, update_mu
from ibdata.dynamics.variants import Parameters

DYNAMICS_SLOTS = 8  # random integers of a step
DRIFT_SLOTS = 4  # further ones, of a moving setpoint
NOISE_ROWS = DYNAMICS_SLOTS + DRIFT_SLOTS


class Noise(NamedTuple):
    """The random numbers of one step of n lanes in standard form: arrays (n,), the rows of a table."""

    exp_v: Floats  # Exp(1)
    exp_g: Floats
    bernoulli_v: Floats  # U(0, 1); the event is u < p
    bernoulli_g: Floats
    uniform_v: Floats  # U(0, 1)
    uniform_g: Floats
    normal_alpha: Floats  # N(0, 1)
    normal_consumption: Floats
    uniform_drift_length: Floats  # U(0, 1); used by moving setpoints only
    uniform_drift_rate: Floats
    uniform_drift_zero: Floats
    uniform_drift_flip: Floats


# A uniform draw is below 1, and -log of the least double is below 745.2; no normal draw exceeds 40.
RANGES = {
    "exp": (0.0, 745.2, "Exp(1)"),
    "bernoulli": (0.0, 1.0 - 2.0**-53, "U(0, 1)"),
    "uniform": (0.0, 1.0 - 2.0**-53, "U(0, 1)"),
    "normal": (-40.0, 40.0, "N(0, 1)"),
}
OF_FIELDS = [RANGES[name.partition("_")[0]] for name in Noise._fields]
LOW, HIGH = (np.array([[ends[i]] for ends in OF_FIELDS]) for i in (0, 1))


def checked_noise(noise: Noise, n: int) -> Floats:
    """The noise as a table (12, n). Raises ValueError if a field is not n numbers of its law."""
    draws = [np.asarray(x, dtype=np.float64) for x in noise]
    table = np.array(draws) if all(x.shape == (n,) for x in draws) else np.full(n, np.nan)
    if not np.all((table >= LOW) & (table <= HIGH)):  # at once: twelve checks take longer than a step
        wrong = (
            f"step: noise.{name}: found {x}, expected {n} numbers of {law}"
            for name, x, (low, high, law) in zip(Noise._fields, draws, OF_FIELDS, strict=True)
            if x.shape != (n,) or not np.all((x >= low) & (x <= high))
        )
        raise ValueError(next(wrong))
    return table


@compiled
def standard_noise(raw: Raw, rows: Floats) -> None:
    """Fill the first eight rows, which every step uses, from integers (8, n)."""
    for j in range(2):
        for i in range(raw.shape[1]):
            rows[j, i] = exponential(uniform(raw[j, i]))
    for j in range(2, DYNAMICS_SLOTS):
        for i in range(raw.shape[1]):
            rows[j, i] = uniform(raw[j, i])
    normals(rows[6])
    normals(rows[7])


@compiled
def drift_noise(raw: Raw, rows: Floats) -> None:
    """Fill the last four rows, which a moving setpoint uses, from integers (4, n)."""
    for j in range(DRIFT_SLOTS):
        for i in range(raw.shape[1]):
            rows[DYNAMICS_SLOTS + j, i] = uniform(raw[j, i])


SMALLEST = 1e-6  # effective value; the law is continuous, and a smaller one changes it by less
PANELS, ORDER = 128, 2  # of the quadrature on [0, 1]: short intervals, since ∫ min(K, 1 - K) has a kink


def squashed_exponential_cdf(x: Floats, k: Parameters) -> Floats:
    """P(ηᵉ <= x) of ηᵉ = scale · (σ(mean · e) - shift), where e ~ Exp(1).

        P(ηᵉ <= x) = 1 - ((1 - y) / y)^(1/mean), y = x / scale + shift in [½, 1]

    Hein et al. 2017, section "Dynamics of fatigue"; see `squashed_exponential`.

    >>> from ibdata.dynamics import SIEMENS
    >>> squashed_exponential_cdf(np.array([-1.0, 0.0, 0.1, 1.0]), SIEMENS.parameters).round(4).tolist()
    [0.0, 0.0, 0.8656, 1.0]
    """
    scale, shift = k.eta_squash
    y = np.clip(x / scale + shift, 0.5, 1.0)
    cdf: Floats = 1.0 - ((1.0 - y) / y) ** (1.0 / k.eta_mean)
    return cdf


def noise_component_cdf(x: Floats, effective: Floats, k: Parameters) -> Floats:
    """P(η <= x) of η = ηᵉ + (1 - ηᵉ) · ηᵘ · ηᵇ · effective; see `mixed_noise`.

    Without the event, η = ηᵉ. With it, 1 - η = (1 - ηᵉ) s, where s = 1 - effective · ηᵘ is uniform on
    [1 - effective, 1]. So, with n = 1/mean and b = (1 - x) / scale, for a variant whose ηᵉ reaches 1,

        P(η <= x) = ∫ (1 - (b / (s - b))ⁿ) ds / effective, over s from max(2 b, 1 - effective) to 1

    Args:
        x: In [0, 1], of a shape that broadcasts with the other.
        effective: The effective value vᵉ or gᵉ, in [0, 1].
        k: The variant; 1/scale + shift of its `eta_squash` must be 1, as in both published ones.

    >>> from ibdata.dynamics import SIEMENS
    >>> noise_component_cdf(np.array([0.0, 0.5, 1.0]), np.array(0.8), SIEMENS.parameters).round(4).tolist()
    [0.0, 0.6722, 1.0]
    """
    length = np.maximum(effective, SMALLEST)
    # ½: x is at or below ηᵉ's range; above 0, because powers of b may be negative
    b = np.clip((1.0 - x) / k.eta_squash[0], np.finfo(float).tiny, 0.5)
    first = np.clip(2.0 * b, 1.0 - length, 1.0)  # at s = 2 b, ηᵉ is at its least
    low, high = (b / (s - b) for s in (1.0, first))
    power = 1.0 / k.eta_mean - 1.0
    # near a power of 0, the difference has no digits
    below = b * (np.log(high / low) if abs(power) < 1e-7 else (high**power - low**power) / power)
    with_event = np.clip((1.0 - first - below) / length, 0.0, 1.0)
    p = np.clip(effective, *k.bernoulli_bounds)
    cdf: Floats = (1.0 - p) * squashed_exponential_cdf(x, k) + p * with_event
    return cdf


def least_noise(mu: Floats, effective: Floats, k: Parameters) -> Floats:
    """The least η at which the next μ reaches the threshold of α; ∞ if none does, -∞ if every one does.

    The inverse of `update_mu`, whose μ' is linear in η or does not depend on it.

    >>> from ibdata.dynamics import PAPER
    >>> mu, effective = np.array([1.0, 1.2, 1.2]), np.array([0.5, 0.5, 0.01])
    >>> least_noise(mu, effective, PAPER.parameters).round(6).tolist()
    [0.9, -inf, inf]
    """
    pairs = [*zip(mu.tolist(), effective.tolist(), strict=True)]
    without, with_most = (np.array([update_mu(*pair, eta) for pair in pairs]) for eta in (0.0, 1.0))
    slope, sure = with_most - without, np.where(without >= k.alpha_threshold, -np.inf, np.inf)
    least: Floats = np.divide(k.alpha_threshold - without, slope, out=sure, where=slope > 0.0)
    return least


def amplification_cdf(
    x: Floats, mu_v: Floats, mu_g: Floats, effective_v: Floats, effective_g: Floats, k: Parameters
) -> Floats:
    """P(α <= x) of the next α, given the last μ and the next effective values; see `amplification`.

    With κᵛ and κᵍ of `least_noise`, and independent ηᵛ and ηᵍ,

        P(α <= x) = P(ηᵛ <= min(x, κᵛ)) P(ηᵍ <= min(x, κᵍ))
                    + (1 - P(ηᵛ < κᵛ) P(ηᵍ < κᵍ)) Φ((logit x - 2.4) / 0.4)

    Args:
        x: In (0, 1), (m,).
        mu_v: μᵛ before the step (n,).
        mu_g: μᵍ before the step (n,).
        effective_v: vᵉ after the step (n,).
        effective_g: gᵉ after the step (n,).
        k: The variant.

    Returns:
        The probabilities (n, m).
    """
    below: Floats = np.ones((len(mu_v), len(x)))
    both = np.ones((len(mu_v), 1))
    for mu, effective in ((mu_v, effective_v[:, None]), (mu_g, effective_g[:, None])):
        least = least_noise(mu, effective[:, 0], k)[:, None]
        short = np.where(least < 0.0, 0.0, noise_component_cdf(np.clip(least, 0.0, 1.0), effective, k))
        both = both * short
        below *= np.minimum(noise_component_cdf(x, effective, k), short)
    z = (np.log(x / (1.0 - x)) - ALPHA_MEAN) / ALPHA_SD
    bifurcated = np.array([0.5 * math.erfc(-each / math.sqrt(2.0)) for each in z.tolist()])
    cdf: Floats = below + (1.0 - both) * bifurcated
    return cdf


def quadrature() -> tuple[Floats, Floats]:
    """Points in (0, 1) and weights: the Gauss-Legendre rule in each of several intervals, (m,) each."""
    points, weights = np.polynomial.legendre.leggauss(ORDER)
    starts = np.arange(PANELS)[:, None]
    return ((starts + (points + 1.0) / 2.0) / PANELS).ravel(), np.tile(weights / 2.0 / PANELS, PANELS)
