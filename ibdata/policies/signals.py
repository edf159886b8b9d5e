"""Noise and held actions around a base, and signals that excite a system for its identification."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from ibdata._numerics.arrays import Floats
from ibdata._numerics.compiled import compiled
from ibdata._numerics.random import standard_normal
from ibdata.errors import Problems
from ibdata.policies.base import FROM_FLOAT, Decision, Deterministic, Needs, Observed
from ibdata.policies.baselines import Constant
from ibdata.policies.compound import AnyPolicy, DeterministicBase, DrawsNothing, Probability, Unnamed, Wrapper
from ibdata.policies.distributions import Certain, ClippedNormal
from ibdata.policies.replaced import OrCertain

# For less noise, float32 has too few actions: each is drawn again and again, so that no density is right.
Deviation = Annotated[float, Field(ge=1e-5, le=1e9, strict=True)]


class Gaussian(Wrapper):
    """Adds N(0, scale²) to each number of the base's action, and clips the sum to [-1, 1].

    The base must be deterministic, because a random base would give no simple density.
    """

    own_needs: ClassVar[Needs] = Needs(history=0, draws=3)

    kind: Literal["gaussian"] = "gaussian"
    base: Annotated[DeterministicBase, Unnamed, DrawsNothing] = Field(description="a deterministic policy")
    scale: Deviation = Field(description="standard deviation of the noise")

    def decide(self, observed: Observed) -> Decision:
        base, memory = self.base_action(observed)
        return Decision(ClippedNormal(base, self.scale), memory)


class OrnsteinUhlenbeck(Wrapper):
    """Adds an Ornstein-Uhlenbeck process to each number of the base's action, and clips the sum to [-1, 1].

        x[t] = (1 - theta) x[t-1] + sigma n[t],    n[t] ~ N(0, 1),    x before the first step is 0

    The process itself is not clipped; the density is conditional on it. Its standard deviation grows to
    sigma / √(1 - (1 - theta)²), by default 0.38. Sources: Uhlenbeck and Ornstein 1930, On the theory of
    the Brownian motion; for exploration, with these defaults, Lillicrap et al. 2016 (arXiv 1509.02971),
    section 7.
    """

    own_needs: ClassVar[Needs] = Needs(history=0, draws=3, memory=3)  # the memory is x

    kind: Literal["ornstein_uhlenbeck"] = "ornstein_uhlenbeck"
    base: Annotated[DeterministicBase, Unnamed, DrawsNothing] = Field(
        default=Constant(), description="a deterministic policy; by default constant, with the action 0"
    )
    theta: Annotated[float, Field(ge=1e-9, le=1.0, strict=True)] = Field(
        default=0.15, description="share of the distance to 0 by which the process returns per step"
    )
    sigma: Deviation = Field(
        default=0.2, description="standard deviation of the random number added to the process per step"
    )

    def decide(self, observed: Observed) -> Decision:
        (base, memory), process = self.base_action(observed), self.beyond_base(observed)
        mean = base + (1.0 - self.theta) * process.memory
        x = _moved(process.memory, process.draws, self.theta, self.sigma)
        return Decision(ClippedNormal(mean, self.sigma), np.concatenate([memory, x], axis=1))


@compiled
def _moved(before: Floats, u: Floats, theta: float, sigma: float) -> Floats:
    x = np.empty((before.shape[0], 3))
    for i in range(x.shape[0]):
        for j in range(3):
            x[i, j] = (1.0 - theta) * before[i, j] + sigma * standard_normal(u[i, j])
    return x


class Sticky(Wrapper):
    """Repeats the last action with probability κ; else, and at the first step, the base acts.

    An action is held for 1/(1 - κ) steps on average. Source: Machado et al. 2018, Revisiting the Arcade
    Learning Environment, where sticky actions belong to the environment.
    """

    own_needs: ClassVar[Needs] = Needs(history=1, draws=1)

    kind: Literal["sticky"] = "sticky"
    base: Annotated[AnyPolicy, Unnamed] = Field(description="the policy whose actions are repeated")
    kappa: Probability = Field(description="probability of repeating the last action, in [0, 1]")

    def decide(self, observed: Observed) -> Decision:
        base, memory = self.base_distribution(observed)
        kappa = np.where(observed.step > 0, self.kappa, 0.0)  # at the first step there is nothing to repeat
        last = Certain(observed.actions[:, 0])
        return Decision(OrCertain(kappa, base, last, first=self.base.needs.draws), memory)


# The bits of a shift register of that many bits whose parity is shifted in, for the longest period: exponents
# of primitive polynomials over GF(2), as in Peterson and Weldon 1972, Error-Correcting Codes, appendix C.
TAPS = {
    2: (2, 1), 3: (3, 2), 4: (4, 3), 5: (5, 3), 6: (6, 5), 7: (7, 6), 8: (8, 6, 5, 4), 9: (9, 5), 10: (10, 7),
    11: (11, 9), 12: (12, 11, 10, 4),
}  # fmt: skip
TWO_PI = float.fromhex("0x1.921fb54442d18p+2")
Amplitude = Annotated[float, Field(gt=0.0, le=1.0, strict=True)]


class Prbs(Deterministic):
    """Moves each steering up or down by the same amount, in the order of a pseudo-random binary signal.

    The signal is a sequence of maximal length from a shift register with feedback. From bit to bit, its
    autocorrelation is nearly that of white noise. The three numbers of the action follow it a third of it
    apart. An episode begins at a random place; given this place, its actions have the probability 1. Source:
    Ljung 1999, System Identification, chapter 13.
    """

    needs: ClassVar[Needs] = Needs(history=0, episode_draws=1)

    kind: Literal["prbs"] = "prbs"
    order: Annotated[int, Field(ge=2, le=12, strict=True), FROM_FLOAT] = Field(
        default=8, description="bits of the shift register; the sequence has 2^order - 1 bits"
    )
    hold: Annotated[int, Field(ge=1, le=1000, strict=True), FROM_FLOAT] = Field(
        default=4, description="steps for which a bit is held"
    )
    amplitude: Amplitude = Field(default=1.0, description="the size of each number of the action")

    def decide(self, observed: Observed) -> Decision:
        signs = sequence(self.order)
        length = len(signs)
        start = np.floor(observed.episode_draws[:, 0] * (length * self.hold)).astype(np.int64)
        bit = (start + observed.step) // self.hold
        apart = np.arange(3) * (length // 3)
        return Decision(self.amplitude * signs[(bit[:, None] + apart) % length], observed.memory)


@lru_cache
def sequence(order: int) -> Floats:
    """The 2^order - 1 signs, 1.0 or -1.0, of the register that begins with ones only.

    >>> sequence(3).tolist()
    [1.0, 1.0, 1.0, -1.0, -1.0, 1.0, -1.0]
    """
    register = [1] * order
    signs = np.empty(2**order - 1)
    for i in range(len(signs)):
        signs[i] = 2.0 * register[-1] - 1.0
        register = [sum(register[tap - 1] for tap in TAPS[order]) % 2, *register[:-1]]
    signs.flags.writeable = False
    return signs


class Multisine(Deterministic):
    """Moves each steering by a sum of K sines of equal power, with few high peaks.

        x_j[t] ∝ Σ_i cos(2π (3i + j - 3) t/N - π i (i - 1)/K),    i = 1 … K,    j = 1, 2, 3

    The three numbers of the action are uncorrelated over a period. An episode begins at a random time of it;
    given this time, its actions have the probability 1. Sources: Schroeder 1970, Synthesis of low-peak-factor
    signals; Ljung 1999, System Identification, chapter 13.
    """

    needs: ClassVar[Needs] = Needs(history=0, episode_draws=1)

    kind: Literal["multisine"] = "multisine"
    sines: Annotated[int, Field(ge=1, le=1000, strict=True), FROM_FLOAT] = Field(
        default=10, description="K, the number of sines of each number of the action"
    )
    period: Annotated[int, Field(ge=8, le=10_000, strict=True), FROM_FLOAT] = Field(
        default=1000, description="N, the steps of a period; more than 6 K"
    )
    amplitude: Amplitude = Field(default=1.0, description="the highest peak")

    def decide(self, observed: Observed) -> Decision:
        start = np.floor(observed.episode_draws[:, 0] * self.period).astype(np.int64)
        signals = waves(self.sines, self.period)
        return Decision(self.amplitude * signals[(start + observed.step) % self.period], observed.memory)

    @model_validator(mode="after")
    def _check(self) -> Multisine:
        if self.period <= 6 * self.sines:
            expected = f"more than {6 * self.sines}, which is 6 for each of the sines"
            raise Problems([(("period",), f"found {self.period}, expected {expected}")])
        return self


@lru_cache
def waves(sines: int, period: int) -> Floats:
    """The three signals (period, 3), with the highest peak 1."""
    out = _waves(sines, period)
    out.flags.writeable = False
    return out


@compiled
def _waves(sines: int, period: int) -> Floats:
    out = np.empty((period, 3))
    for j in range(3):
        peak = 0.0
        for t in range(period):
            total = 0.0
            for i in range(1, sines + 1):
                turns = ((3 * i + j - 2) * t) % period / period
                total += cosine(turns - 0.5 * (i * (i - 1)) / sines)
            out[t, j] = total
            peak = max(peak, abs(total))
        for t in range(period):
            out[t, j] /= peak
    return out


@compiled
def cosine(turns: float) -> float:
    """Cosine of 2π · turns, for |turns| < 2⁵⁰, made like the functions of `exact`.

    A whole turn can be taken off without rounding. The largest error measured is 1.2e-16.

    >>> float(cosine(0.0)), float(cosine(0.25)), float(cosine(-0.5)), float(cosine(1.125))
    (1.0, 0.0, -1.0, 0.7071067811865476)
    """
    quarters = np.rint(4.0 * turns)
    x = TWO_PI * (turns - 0.25 * quarters)
    which = quarters - 4.0 * np.floor(0.25 * quarters)
    if which == 0.0:
        return _cosine(x)
    if which == 1.0:
        return 0.0 - _sine(x)
    return 0.0 - _cosine(x) if which == 2.0 else _sine(x)


@compiled
def _sine(x: float) -> float:
    """Taylor series to x¹⁷, for |x| <= π/4."""
    q = x * x
    s = 1 / 355687428096000.0
    s = s * -q + 1 / 1307674368000.0
    s = s * -q + 1 / 6227020800.0
    s = s * -q + 1 / 39916800.0
    s = s * -q + 1 / 362880.0
    s = s * -q + 1 / 5040.0
    s = s * -q + 1 / 120.0
    s = s * -q + 1 / 6.0
    return x - x * (q * s)


@compiled
def _cosine(x: float) -> float:
    """Taylor series to x¹⁶, for |x| <= π/4."""
    q = x * x
    s = 1 / 20922789888000.0
    s = s * -q + 1 / 87178291200.0
    s = s * -q + 1 / 479001600.0
    s = s * -q + 1 / 3628800.0
    s = s * -q + 1 / 40320.0
    s = s * -q + 1 / 720.0
    s = s * -q + 1 / 24.0
    s = s * -q + 0.5
    return 1.0 - q * s
