"""Fatigue: effective velocity and gain, their noise, the latent μ, and the amplification α."""

from __future__ import annotations

from ibdata._numerics.compiled import compiled
from ibdata._numerics.exact import clip, logistic
from ibdata.dynamics.variants import Pair, Parameters
from ibdata.views.variables import AMPLIFICATION_START

TOLERANCE = 0.05  # an effective value of at most this resets its μ
AMPLIFICATION = 1.1
AMPLIFICATION_MAX = 5.0
ALPHA_MEAN = 2.4
ALPHA_SD = 0.4


@compiled
def velocity_transform(v: float, g: float, p: float) -> float:
    """Tᵛ(v, g, p) = (g + p + 2) / (v - p + 101).

    Hein et al. 2017, Eq. (24); both variants. v, g, p in [0, 100].

    >>> velocity_transform(50.0, 50.0, 50.0)
    1.00990099009901
    """
    return (g + p + 2.0) / (v - p + 101.0)


@compiled
def gain_transform(g: float, p: float) -> float:
    """Tᵍ(g, p) = 1 / (g + p + 1).

    Hein et al. 2017, Eq. (25); both variants. g, p in [0, 100].

    >>> gain_transform(49.0, 50.0)
    0.01
    """
    return 1.0 / (g + p + 1.0)


@compiled
def effective_velocity(v: float, g: float, p: float, ends: tuple[Pair, Pair]) -> float:
    """Effective velocity vᵉ, which is 0 at the first end (v₀, g₀) and 1 at the second, (v₁, g₁).

        vᵉ = (Tᵛ(v,g,p) - Tᵛ(v₀,g₀,p)) / (Tᵛ(v₁,g₁,p) - Tᵛ(v₀,g₀,p))

    Hein et al. 2017, Eq. (26) with (0, 100) and (100, 0). EffectiveAction.py exchanges the two, so its vᵉ
    is 1 minus the paper's.

    >>> effective_velocity(100.0, 0.0, 50.0, ((0.0, 100.0), (100.0, 0.0)))
    1.0
    """
    (v0, g0), (v1, g1) = ends
    t0 = velocity_transform(v0, g0, p)
    t1 = velocity_transform(v1, g1, p)
    return (velocity_transform(v, g, p) - t0) / (t1 - t0)


@compiled
def effective_gain(g: float, p: float) -> float:
    """Effective gain gᵉ, which is 0 at g = 100 and 1 at g = 0.

        gᵉ = (Tᵍ(g,p) - Tᵍ(100,p)) / (Tᵍ(0,p) - Tᵍ(100,p))

    Hein et al. 2017, Eq. (27); both variants.

    >>> effective_gain(0.0, 30.0), effective_gain(100.0, 30.0)
    (1.0, 0.0)
    """
    t0 = gain_transform(100.0, p)
    t1 = gain_transform(0.0, p)
    return (gain_transform(g, p) - t0) / (t1 - t0)


@compiled
def bernoulli(u: float, effective: float, low: float, high: float) -> float:
    """A draw b ~ Binom(1, effective): 1 if u ~ U(0, 1) is below the probability, else 0.

    Hein et al. 2017, section "Dynamics of fatigue"; the bounds [low, high] of the probability are a field
    of the variant (IDS.py clips to [0.001, 0.999]).

    >>> bernoulli(0.0005, 0.0, 0.001, 0.999), bernoulli(0.0005, 0.0, 0.0, 1.0)
    (1.0, 0.0)
    """
    return 1.0 if u < clip(effective, low, high) else 0.0


@compiled
def squashed_exponential(e: float, mean: float, scale: float, shift: float) -> float:
    """Noise ηᵉ from a standard exponential draw e ~ Exp(1).

        ηᵉ = scale · (σ(mean · e) - shift)

    Hein et al. 2017, section "Dynamics of fatigue", with mean 0.05, scale 1, shift 0; IDS.py,
    updateFatigue, with 0.1, 2, ½.

    >>> squashed_exponential(0.0, 0.05, 1.0, 0.0), squashed_exponential(0.0, 0.1, 2.0, 0.5)
    (0.5, 0.0)
    """
    return scale * (logistic(mean * e) - shift)


@compiled
def mixed_noise(eta_e: float, u: float, b: float, effective: float) -> float:
    """Noise component η of one effective value, vᵉ or gᵉ.

        η = ηᵉ + (1 - ηᵉ) · ηᵘ · ηᵇ · effective

    Hein et al. 2017, Eqs. (28) and (29); both variants. ηᵘ ~ U(0, 1), ηᵇ in {0, 1}; η in [0, 1].

    >>> mixed_noise(0.5, 0.5, 1.0, 0.8)
    0.7
    """
    return eta_e + (1.0 - eta_e) * u * b * effective


@compiled
def noise_component(e: float, u: float, u_event: float, effective: float, k: Parameters) -> float:
    """Noise component η from standard draws: e ~ Exp(1) for ηᵉ, u ~ U(0, 1) for ηᵘ, u_event ~ U(0, 1) for ηᵇ.

    >>> from ibdata.dynamics import SIEMENS
    >>> noise_component(0.0, 0.5, 0.1, 0.8, SIEMENS.parameters)
    0.4
    """
    eta_e = squashed_exponential(e, k.eta_mean, *k.eta_squash)
    b = bernoulli(u_event, effective, *k.bernoulli_bounds)
    return mixed_noise(eta_e, u, b, effective)


@compiled
def update_mu(mu: float, effective: float, eta: float) -> float:
    """Next latent μ of one effective value with noise η.

        μ = effective         if effective <= 0.05
        μ = min(5, 1.1 μ)     if μ >= 1.2
        μ = 0.9 μ + η/3       else

    Hein et al. 2017, Eqs. (30) and (31), where neither μ depends on the other; both variants.

    >>> update_mu(3.0, 0.05, 0.9), update_mu(4.9, 0.5, 0.9), update_mu(1.0, 0.5, 0.3)
    (0.05, 5.0, 1.0)
    """
    if effective <= TOLERANCE:
        return effective
    if mu >= AMPLIFICATION_START:
        return min(AMPLIFICATION_MAX, AMPLIFICATION * mu)
    return 0.9 * mu + eta / 3.0


@compiled
def amplification(mu_v: float, mu_g: float, eta_v: float, eta_g: float, z: float, threshold: float) -> float:
    """Amplification α, which bifurcates when a μ reaches the threshold; z ~ N(0, 1).

        α = σ(2.4 + 0.4 z)    if max(μᵛ, μᵍ) >= threshold
        α = max(ηᵛ, ηᵍ)       else

    Hein et al. 2017, Eq. (23), with the threshold 1.2 (printed "= 1.2"); IDS.py, updateFatigue, with 5, the
    cap of μ.

    >>> amplification(1.0, 1.1, 0.2, 0.3, 0.0, 1.2)
    0.3
    >>> round(float(amplification(1.0, 1.2, 0.2, 0.3, 0.0, 1.2)), 4)
    0.9168
    """
    if max(mu_v, mu_g) >= threshold:
        return logistic(ALPHA_MEAN + ALPHA_SD * z)
    return max(eta_v, eta_g)


@compiled
def basic_fatigue(v: float, g: float) -> float:
    """Basic fatigue f_b of velocity v and gain g, both in [0, 100].

        f_b = max(0, 30000 / (5 v + 100) - 0.01 g²)

    Hein et al. 2017, Eq. (21); both variants. f_b in [0, 300].

    >>> basic_fatigue(0.0, 0.0), basic_fatigue(100.0, 100.0)
    (300.0, 0.0)
    """
    return max(0.0, 30000.0 / (5.0 * v + 100.0) - 0.01 * (g * g))


@compiled
def fatigue(f_b: float, alpha: float) -> float:
    """Fatigue f from basic fatigue f_b and amplification α in [0, 1].

        f = f_b (1 + 2 α) / 3

    Hein et al. 2017, Eq. (22); both variants. f / f_b in [1/3, 1].

    >>> fatigue(300.0, 0.0), fatigue(300.0, 1.0)
    (100.0, 300.0)
    """
    return f_b * (1.0 + 2.0 * alpha) / 3.0
