"""The two published systems as data: `SIEMENS`, the authors' code, and `PAPER`, the printed equations.

Hein et al. 2017, *A Benchmark Environment Motivated by Industrial Control Problems* (arXiv 1709.09480),
and the authors' `industrial-benchmark-python` 2.0 (files `IDS.py` and `EffectiveAction.py`) differ in the
fields below and in nothing else. The dynamics depend on these fields only.
"""

from __future__ import annotations

import math
import operator
from collections import namedtuple
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from itertools import count
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

Pair = tuple[float, float]


class Declared(NamedTuple):
    """The published values of a field of a `Variant`, and what any value must be."""

    paper: Any
    siemens: Any
    rule: str
    limits: dict[str, Any]  # of each of its numbers: gt, ge and le
    holds: Callable[[Any], bool]  # what the rule says beyond the limits

    def allows(self, value: Any) -> bool:
        """Whether a value of the right form keeps the rule."""
        kept = (getattr(operator, name)(np.ravel(value), limit).all() for name, limit in self.limits.items())
        return all(kept) and self.holds(value)


def declared(
    rule: str, holds: Callable[[Any], bool] = lambda value: True, *, paper: Any, siemens: Any, **limits: Any
) -> dict[str, Declared]:
    """The metadata of a field of a `Variant`."""
    return {"declared": Declared(paper, siemens, rule, limits, holds)}


def _squash_in_unit(squash: Pair) -> bool:
    scale, shift = squash
    return scale >= 0.0 and scale * (0.5 - shift) >= 0.0 and scale * (1.0 - shift) <= 1.0


@dataclass(frozen=True)
class Variant:
    """A version of the Industrial Benchmark, with one field for each point on which the sources differ.

    The constructor raises ValueError if a field is not finite, or if it would let a variable leave the range
    that the paper gives.
    """

    # fmt: off
    eta_mean: float = field(metadata=declared(
        "be in (0, 10]", gt=0.0, le=10.0,
        paper=0.05,  # section "Dynamics of fatigue": "exponential distribution with mean 0.05"
        siemens=0.1,  # IDS.py, updateFatigue: expLambda
    ))
    """Mean of the exponential draw e behind ηᵛᵉ and ηᵍᵉ."""
    eta_squash: Pair = field(metadata=declared(
        "keep scale · (σ - shift) in [0, 1] for σ in [½, 1]", _squash_in_unit,
        paper=(1.0, 0.0),  # same: "applying the logistic function"
        siemens=(2.0, 0.5),  # IDS.py, updateFatigue: noise_gain, noise_velocity
    ))
    """(scale, shift) of ηᵉ = scale · (σ(e) - shift)."""
    # Tᵛ rises with g and falls with v: only these ends keep vᵉ in [0, 1].
    effective_velocity_ends: tuple[Pair, Pair] = field(metadata=declared(
        "be (0, 100) and (100, 0) in one order or the other",
        lambda ends: {*ends} == {(0.0, 100.0), (100.0, 0.0)}, ge=0.0, le=100.0,
        paper=((0.0, 100.0), (100.0, 0.0)),  # Eq. (26)
        siemens=((100.0, 0.0), (0.0, 100.0)),  # EffectiveAction.py, calcEffectiveVelocity
    ))
    """The (v, g) at which vᵉ is 0 and the (v, g) at which it is 1."""
    bernoulli_bounds: Pair = field(metadata=declared(
        "be ordered in [0, 1]", lambda pair: pair[0] <= pair[1], ge=0.0, le=1.0,
        paper=(0.0, 1.0),  # same section: Binom(1, vᵉ), Binom(1, gᵉ)
        siemens=(0.001, 0.999),  # IDS.py, updateFatigue: noise_b_g, noise_b_v
    ))
    """Bounds to which the probability of ηᵛᵇ and ηᵍᵇ is clipped."""
    alpha_threshold: float = field(metadata=declared(
        "be in [0, 5]", ge=0.0, le=5.0,
        paper=1.2,  # Eq. (23), where "= 1.2" is read as ">= 1.2"
        siemens=5.0,  # IDS.py, updateFatigue: fatigueAmplificationMax, the cap of μ
    ))
    """Value of max(μᵛ, μᵍ) from which α is drawn anew."""
    convolution_weights: tuple[float, float, float, float, float] = field(metadata=declared(
        "be in [0, 1] and sum to 1 within 1e-4",
        lambda weights: abs(sum(weights) - 1.0) <= 1e-4, ge=0.0, le=1.0,
        paper=(1 / 9, 2 / 9, 3 / 9, 2 / 9, 1 / 9),  # Eq. (7)
        siemens=(0.11111, 0.22222, 0.33333, 0.22222, 0.11111),  # IDS.py: ConvArray
    ))
    """Weights of θ[t-5] … θ[t-9] in θᶜ; symmetric in both sources."""
    consumption_offset: float = field(metadata=declared(
        "be in [-100, 100]", ge=-100.0, le=100.0,
        paper=0.0,  # Eq. (19)
        siemens=1.0,  # IDS.py, updateOperationalCosts: rGS - 1.0
    ))
    """Added to m in ĉ = θᶜ + 25 (m + offset)."""
    consumption_noise: float = field(metadata=declared(
        "be in [0, 0.04]", ge=0.0, le=0.04,
        paper=0.02,  # Eq. (20)
        siemens=0.005,  # IDS.py, updateOperationalCosts
    ))
    """k in the standard deviation 1 + k ĉ of the consumption."""
    drift_rate: Pair = field(metadata=declared(
        "be ordered in [-100, 100]", lambda pair: pair[0] <= pair[1], ge=-100.0, le=100.0,
        paper=(0.0, 1.0),  # section "Setpoint dynamics": U(0, 1)
        siemens=(-1.0, 1.0),  # IDS.py, defineNewSequence: p_ch
    ))
    """Range of the uniform rate b of a moving setpoint, in setpoint units per step."""
    drift_length: int = field(metadata=declared(
        "be a whole number in [1, 1e6]", lambda length: length == math.floor(length), ge=1, le=1_000_000,
        paper=100,  # same: U{1, 100}
        siemens=99,  # IDS.py, defineNewSequence: randint(1, 100)
    ))
    """Longest segment of a moving setpoint, in steps; lengths are uniform on 1 … drift_length."""
    # Both flips use the same draw.
    drift_flip: Pair = field(metadata=declared(
        "be two probabilities, one of them 0", lambda flips: flips[0] * flips[1] == 0.0, ge=0.0, le=1.0,
        paper=(0.5, 0.0),  # Eq. (33): flips where p_t is 0 or 100
        siemens=(0.0, 0.5),  # IDS.py, updateSetPoint: flips where p_t + b leaves [0, 100]
    ))
    """Probabilities that b changes sign (before moving, at a bound; after moving, past one); one is 0."""
    # fmt: on

    def __post_init__(self) -> None:
        values = ((name, getattr(self.parameters, name), each) for name, each in FIELDS.items())
        broken = [f"{name} must {each.rule}" for name, value, each in values if not each.allows(value)]
        if broken:
            raise ValueError(f"variant: {'; '.join(broken)}; found {self}")

    @cached_property
    def numbers(self) -> npt.NDArray[np.float64]:
        """The fields one after another, as one array. Raises ValueError if one has the wrong form."""
        for name, each in FIELDS.items():
            if np.shape(value := getattr(self, name)) != np.shape(each.paper):
                raise ValueError(f"variant: {name}: found {value}, expected the form of {each.paper}")
        numbers = np.concatenate([np.ravel(getattr(self, name)) for name in FIELDS], dtype=np.float64)
        numbers.flags.writeable = False
        return numbers

    @cached_property
    def parameters(self) -> Parameters:
        """The fields as compiled code takes them, all numbers as floats."""
        return named(self.numbers.tolist())


FIELDS: dict[str, Declared] = {each.name: each.metadata["declared"] for each in fields(Variant)}
if TYPE_CHECKING:
    Parameters = Variant
else:
    Parameters = namedtuple("Parameters", FIELDS)


def _form(value: Any, at: Iterator[int]) -> str:
    """The expression for a value of this form that holds the numbers x[i], x[i + 1], … from the next i on."""
    if isinstance(value, tuple):
        return f"({''.join(_form(part, at) + ',' for part in value)})"
    return f"x[{next(at)}]"


# The `Parameters` that hold these numbers; an expression, because compiled code makes no tuples in a loop.
named: Callable[[Any], Parameters] = eval(
    f"lambda x: Parameters{_form(tuple(each.paper for each in FIELDS.values()), count())}"
)

PAPER = Variant(**{name: each.paper for name, each in FIELDS.items()})
SIEMENS = Variant(**{name: each.siemens for name, each in FIELDS.items()})
VARIANTS: Mapping[str, Variant] = {"siemens": SIEMENS, "paper": PAPER}


def resolve(variant: Variant | str) -> Variant:
    """The variant, given as such or by name. Raises ValueError for a name that is not in `VARIANTS`."""
    if isinstance(variant, Variant):
        return variant
    if variant not in VARIANTS:
        raise ValueError(f"variant: found {variant!r}, expected one of {', '.join(VARIANTS)} or a Variant")
    return VARIANTS[variant]
