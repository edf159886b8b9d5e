"""The two published systems as data: `SIEMENS`, the authors' code, and `PAPER`, the printed equations.

Hein et al. 2017, *A Benchmark Environment Motivated by Industrial Control Problems* (arXiv 1709.09480),
and the authors' `industrial-benchmark-python` 2.0 (files `IDS.py` and `EffectiveAction.py`) differ in the
fields below and in nothing else. The dynamics read the fields and never ask which variant they run.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

Pair = tuple[float, float]


class Parameters(NamedTuple):
    """The numbers of a `Variant` as the compiled step takes them: floats and tuples of floats only."""

    eta_mean: float
    eta_scale: float
    eta_shift: float
    v0: float
    g0: float
    v1: float
    g1: float
    bernoulli_low: float
    bernoulli_high: float
    alpha_threshold: float
    weights: tuple[float, float, float, float, float]
    consumption_offset: float
    consumption_noise: float
    drift_rate_low: float
    drift_rate_high: float
    drift_length: float
    flip_before: float
    flip_after: float


@dataclass(frozen=True)
class Variant:
    """One reading of the Industrial Benchmark: one field for each decision on which the sources differ.

    Raises ValueError at construction if a field cannot be meant: weights that do not sum to one, equal end
    points, a probability outside [0, 1], unordered bounds, a number that is not finite.
    """

    eta_mean: float
    """Mean of the exponential draw e behind ηᵛᵉ and ηᵍᵉ."""
    eta_squash: Pair
    """(scale, shift) of ηᵉ = scale · (σ(e) - shift)."""
    effective_velocity_ends: tuple[Pair, Pair]
    """The (v, g) at which vᵉ is 0 and the (v, g) at which it is 1."""
    bernoulli_bounds: Pair
    """Bounds to which the probability of ηᵛᵇ and ηᵍᵇ is clipped."""
    alpha_threshold: float
    """α is drawn anew where max(μᵛ, μᵍ) is at least this."""
    convolution_weights: tuple[float, float, float, float, float]
    """Weights of θ[t-5] … θ[t-9] in θᶜ; symmetric in both sources."""
    consumption_offset: float
    """Added to m in ĉ = θᶜ + 25 (m + offset)."""
    consumption_noise: float
    """k in the standard deviation 1 + k ĉ of the consumption."""
    drift_rate: Pair
    """Range of the uniform rate b of a moving setpoint, per step."""
    drift_length: int
    """Longest segment of a moving setpoint, in steps; lengths are uniform on 1 … drift_length."""
    drift_flip: Pair
    """Probability that b changes sign (before moving, at a bound; after moving, past a bound)."""

    def __post_init__(self) -> None:
        numbers = _flatten(self.parameters())
        problems = {
            "every number must be finite": not all(math.isfinite(x) for x in numbers),
            "eta_mean must be positive": self.eta_mean <= 0.0,
            "effective_velocity_ends must give different transforms at every setpoint": not _ends_differ(
                *self.effective_velocity_ends
            ),
            "bernoulli_bounds must be ordered in [0, 1]": not _ordered(0.0, self.bernoulli_bounds, 1.0),
            "convolution_weights must sum to 1 within 1e-4": abs(sum(self.convolution_weights) - 1.0) > 1e-4,
            "consumption_noise must not be negative": self.consumption_noise < 0.0,
            "drift_rate must be ordered in [-100, 100]": not _ordered(-100.0, self.drift_rate, 100.0),
            "drift_length must be a whole number of at least 1": self.drift_length < 1
            or self.drift_length != int(self.drift_length),
            "drift_flip must be probabilities": not all(0.0 <= p <= 1.0 for p in self.drift_flip),
        }
        found = [rule for rule, broken in problems.items() if broken]
        if found:
            raise ValueError(f"Variant: {'; '.join(found)}; found {self}")

    def parameters(self) -> Parameters:
        """The fields as one NamedTuple of numbers, the form in which they enter the kernel."""
        (v0, g0), (v1, g1) = self.effective_velocity_ends
        w5, w6, w7, w8, w9 = (float(w) for w in self.convolution_weights)
        return Parameters(
            eta_mean=float(self.eta_mean),
            eta_scale=float(self.eta_squash[0]),
            eta_shift=float(self.eta_squash[1]),
            v0=float(v0),
            g0=float(g0),
            v1=float(v1),
            g1=float(g1),
            bernoulli_low=float(self.bernoulli_bounds[0]),
            bernoulli_high=float(self.bernoulli_bounds[1]),
            alpha_threshold=float(self.alpha_threshold),
            weights=(w5, w6, w7, w8, w9),
            consumption_offset=float(self.consumption_offset),
            consumption_noise=float(self.consumption_noise),
            drift_rate_low=float(self.drift_rate[0]),
            drift_rate_high=float(self.drift_rate[1]),
            drift_length=float(self.drift_length),
            flip_before=float(self.drift_flip[0]),
            flip_after=float(self.drift_flip[1]),
        )


def _flatten(parameters: Parameters) -> list[float]:
    return [x for field in parameters for x in (field if isinstance(field, tuple) else (field,))]


def _ordered(low: float, pair: Pair, high: float) -> bool:
    return low <= pair[0] <= pair[1] <= high


def _ends_differ(zero: Pair, one: Pair) -> bool:
    """Whether Tᵛ(v, g, p) = (g + p + 2) / (v - p + 101) differs at both ends for every p in [0, 100].

    Both ends in [0, 100]²: the difference, times both positive denominators, is linear in p, so that equal
    signs at p = 0 and p = 100 exclude a root between them.
    """
    (v0, g0), (v1, g1) = zero, one
    if not all(0.0 <= x <= 100.0 for x in (v0, g0, v1, g1)):
        return False
    at = [(g1 + p + 2.0) * (v0 - p + 101.0) - (g0 + p + 2.0) * (v1 - p + 101.0) for p in (0.0, 100.0)]
    return at[0] * at[1] > 0.0


PAPER = Variant(
    eta_mean=0.05,  # section "Dynamics of fatigue": "exponential distribution with mean 0.05"
    eta_squash=(1.0, 0.0),  # same: "applying the logistic function"
    effective_velocity_ends=((0.0, 100.0), (100.0, 0.0)),  # Eq. (26)
    bernoulli_bounds=(0.0, 1.0),  # same section: Binom(1, vᵉ), Binom(1, gᵉ)
    alpha_threshold=1.2,  # Eq. (23), where "= 1.2" is read as ">= 1.2"
    convolution_weights=(1 / 9, 2 / 9, 3 / 9, 2 / 9, 1 / 9),  # Eq. (7)
    consumption_offset=0.0,  # Eq. (19)
    consumption_noise=0.02,  # Eq. (20)
    drift_rate=(0.0, 1.0),  # section "Setpoint dynamics": U(0, 1)
    drift_length=100,  # same: U{1, 100}
    drift_flip=(0.5, 0.0),  # Eq. (33): flips where p_t is 0 or 100
)

SIEMENS = Variant(
    eta_mean=0.1,  # IDS.py, updateFatigue: expLambda
    eta_squash=(2.0, 0.5),  # IDS.py, updateFatigue: noise_gain, noise_velocity
    effective_velocity_ends=((100.0, 0.0), (0.0, 100.0)),  # EffectiveAction.py, calcEffectiveVelocity
    bernoulli_bounds=(0.001, 0.999),  # IDS.py, updateFatigue: noise_b_g, noise_b_v
    alpha_threshold=5.0,  # IDS.py, updateFatigue: fatigueAmplificationMax, the cap of μ
    convolution_weights=(0.11111, 0.22222, 0.33333, 0.22222, 0.11111),  # IDS.py: ConvArray
    consumption_offset=1.0,  # IDS.py, updateOperationalCosts: rGS - 1.0
    consumption_noise=0.005,  # IDS.py, updateOperationalCosts
    drift_rate=(-1.0, 1.0),  # IDS.py, defineNewSequence: p_ch
    drift_length=99,  # IDS.py, defineNewSequence: randint(1, 100)
    drift_flip=(0.0, 0.5),  # IDS.py, updateSetPoint: flips where p_t + b leaves [0, 100]
)

VARIANTS: Mapping[str, Variant] = {"siemens": SIEMENS, "paper": PAPER}


def resolve(variant: Variant | str) -> Variant:
    """The variant itself, or the one of that name; ValueError for a name that is not in `VARIANTS`."""
    if isinstance(variant, Variant):
        return variant
    if variant not in VARIANTS:
        raise ValueError(f"variant: found {variant!r}, expected one of {', '.join(VARIANTS)} or a Variant")
    return VARIANTS[variant]
