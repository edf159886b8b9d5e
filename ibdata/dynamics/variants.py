"""The two published systems as data: `SIEMENS`, the authors' code, and `PAPER`, the printed equations.

Hein et al. 2017, *A Benchmark Environment Motivated by Industrial Control Problems* (arXiv 1709.09480),
and the authors' `industrial-benchmark-python` 2.0 (files `IDS.py` and `EffectiveAction.py`) differ in the
fields below and in nothing else. The dynamics depend on these fields only.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

Pair = tuple[float, float]
COUNT = 22  # of the numbers in the fields of a `Variant`


class Parameters(NamedTuple):
    """The numbers in the fields of a `Variant`, in their order, by names that compiled code accepts."""

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


def named(x: Any) -> Parameters:
    """The names of numbers (22,), which are the fields of a `Variant` one after another; also compiled."""
    return Parameters(
        x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7], x[8], x[9], (x[10], x[11], x[12], x[13], x[14]),
        x[15], x[16], x[17], x[18], x[19], x[20], x[21],
    )  # fmt: skip


class VariantError(ValueError):
    """A field of a `Variant` breaks its rule; `broken` has the rules of these fields."""

    def __init__(self, message: str, broken: dict[str, str]) -> None:
        super().__init__(message)
        self.broken = broken


def broken_rules(k: Parameters) -> dict[str, str]:
    """What the fields must be that are not so, by their names."""
    rules = {
        "eta_mean": ("be in (0, 10]", 0.0 < k.eta_mean <= 10.0),
        "eta_squash": (
            "keep scale · (σ - shift) in [0, 1] for σ in [½, 1]",
            k.eta_scale >= 0.0
            and k.eta_scale * (0.5 - k.eta_shift) >= 0.0
            and k.eta_scale * (1.0 - k.eta_shift) <= 1.0,
        ),
        # Tᵛ rises with g and falls with v: only these ends keep vᵉ in [0, 1].
        "effective_velocity_ends": (
            "be (0, 100) and (100, 0) in one order or the other",
            {(k.v0, k.g0), (k.v1, k.g1)} == {(0.0, 100.0), (100.0, 0.0)},
        ),
        "bernoulli_bounds": ("be ordered in [0, 1]", 0.0 <= k.bernoulli_low <= k.bernoulli_high <= 1.0),
        "alpha_threshold": ("be in [0, 5]", 0.0 <= k.alpha_threshold <= 5.0),
        "convolution_weights": (
            "be in [0, 1] and sum to 1 within 1e-4",
            all(0.0 <= w <= 1.0 for w in k.weights) and abs(sum(k.weights) - 1.0) <= 1e-4,
        ),
        "consumption_offset": ("be in [-100, 100]", abs(k.consumption_offset) <= 100.0),
        "consumption_noise": ("be in [0, 0.04]", 0.0 <= k.consumption_noise <= 0.04),
        "drift_rate": (
            "be ordered in [-100, 100]",
            -100.0 <= k.drift_rate_low <= k.drift_rate_high <= 100.0,
        ),
        "drift_length": (
            "be a whole number in [1, 1e6]",
            1.0 <= k.drift_length <= 1e6 and k.drift_length == math.floor(k.drift_length),
        ),
        # Both flips use the same draw.
        "drift_flip": (
            "be two probabilities, one of them 0",
            0.0 <= k.flip_before <= 1.0
            and 0.0 <= k.flip_after <= 1.0
            and k.flip_before * k.flip_after == 0.0,
        ),
    }
    return {field: rule for field, (rule, holds) in rules.items() if not holds}


@dataclasses.dataclass(frozen=True)
class Variant:
    """A version of the Industrial Benchmark, with one field for each point on which the sources differ.

    The constructor raises ValueError if a field is not finite, or if it would let a variable leave the range
    that the paper gives.
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
    """Value of max(μᵛ, μᵍ) from which α is drawn anew."""
    convolution_weights: tuple[float, float, float, float, float]
    """Weights of θ[t-5] … θ[t-9] in θᶜ; symmetric in both sources."""
    consumption_offset: float
    """Added to m in ĉ = θᶜ + 25 (m + offset)."""
    consumption_noise: float
    """k in the standard deviation 1 + k ĉ of the consumption."""
    drift_rate: Pair
    """Range of the uniform rate b of a moving setpoint, in setpoint units per step."""
    drift_length: int
    """Longest segment of a moving setpoint, in steps; lengths are uniform on 1 … drift_length."""
    drift_flip: Pair
    """Probabilities that b changes sign (before moving, at a bound; after moving, past one); one is 0."""

    def __post_init__(self) -> None:
        if broken := broken_rules(self.parameters):
            said = "; ".join(f"{field} must {rule}" for field, rule in broken.items())
            raise VariantError(f"variant: {said}; found {self}", broken)

    @cached_property
    def numbers(self) -> npt.NDArray[np.float64]:
        """The fields as one array (22,), in their order. Raises ValueError if one has the wrong length."""
        fields = [np.ravel(getattr(self, field.name)) for field in dataclasses.fields(self)]
        numbers = np.concatenate(fields, dtype=np.float64)
        if len(numbers) != COUNT:
            raise ValueError(f"variant: found a pair or weights of the wrong length in {self}")
        numbers.flags.writeable = False
        return numbers

    @cached_property
    def parameters(self) -> Parameters:
        """The fields as numbers with names. Raises ValueError if one has the wrong length."""
        return named(self.numbers.tolist())


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
    """The variant, given as such or by name. Raises ValueError for a name that is not in `VARIANTS`."""
    if isinstance(variant, Variant):
        return variant
    if variant not in VARIANTS:
        raise ValueError(f"variant: found {variant!r}, expected one of {', '.join(VARIANTS)} or a Variant")
    return VARIANTS[variant]
