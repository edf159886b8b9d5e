"""A base policy with noise on its actions, or with actions that are held."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, Field

from ibdata.numerics.circle import cosine, sine
from ibdata.numerics.compiled import compiled
from ibdata.numerics.exact import pow
from ibdata.numerics.random import standard_normal
from ibdata.policies.base import Decision, Float32s, Floats, Needs, Observed, Steps
from ibdata.policies.baselines import Constant
from ibdata.policies.compound import DrawsNothing, Probability, Unnamed, Wrapper
from ibdata.policies.distributions import Certain, ClippedNormal
from ibdata.policies.kinds import AnyPolicy, DeterministicBase
from ibdata.policies.replaced import OrCertain

# For less noise, float32 has too few actions: each is drawn again and again, so that no density is right.
Deviation = Annotated[float, Field(ge=1e-5, le=1e9, strict=True)]


class Gaussian(Wrapper):
    """Adds N(0, scale²) to each number of the base's action, and clips the sum to [-1, 1].

    The base must be deterministic, because a random base would give no simple density.
    """

    own_needs: ClassVar[Needs] = Needs(history=0, step_draws=3)

    kind: Literal["gaussian"] = "gaussian"
    base: Annotated[DeterministicBase, Unnamed, DrawsNothing] = Field(description="a deterministic policy")
    scale: Deviation = Field(description="standard deviation of the noise")

    def decide(self, observed: Observed) -> Decision:
        base, memory = self.base_action(observed)
        return Decision(ClippedNormal(base, self.scale), memory)


class OrnsteinUhlenbeck(Wrapper):
    """Adds an Ornstein-Uhlenbeck process to each number of the base's action, and clips the sum to [-1, 1].

        x[t] = (1 - θ) x[t-1] + σ z,    z ~ N(0, 1),    x before the first step is 0

    The process itself is not clipped; the density is conditional on it. Its standard deviation grows to
    σ / √(1 - (1 - θ)²), by default 0.38. Sources: Uhlenbeck and Ornstein 1930, On the theory of the Brownian
    motion; for exploration, with these defaults, Lillicrap et al. 2016 (arXiv 1509.02971), section 7.
    """

    own_needs: ClassVar[Needs] = Needs(history=0, step_draws=3, memory=3)  # the memory is x

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
        x = _moved(process.memory, process.uniforms, self.theta, self.sigma)
        return Decision(ClippedNormal(mean, self.sigma), np.concatenate([memory, x], axis=1))


@compiled
def _moved(before: Floats, u: Floats, theta: float, sigma: float) -> Floats:
    x = np.empty((before.shape[0], 3))
    for i in range(x.shape[0]):
        for j in range(3):
            x[i, j] = (1.0 - theta) * before[i, j] + sigma * standard_normal(u[i, j])
    return x


def _power_of_two(value: int) -> int:
    if value & (value - 1):
        raise ValueError(f"found {value}, expected a power of two")
    return value


class ColouredNoise(Wrapper):
    """Adds noise with the power spectrum 1/f^β to each number of the base's action, and clips to [-1, 1].

        x[t] = Σ_k s_k (A_k cos 2πkt/N + B_k sin 2πkt/N),    s_k ∝ k^(-β/2),    k = 1 … N/2

    A_k and B_k ~ N(0, 1) are drawn once for an episode; the s_k make the variance of x equal to 1, and
    `scale` · x is added. β = 0 is white, 1 pink, 2 brown noise. `action_log_prob` is NaN. Sources: Timmer and
    König 1995, On generating power law noise; for exploration Eberhard et al. 2023, Pink noise is all you
    need, who recommend β = 1.
    """

    kind: Literal["coloured_noise"] = "coloured_noise"
    base: Annotated[DeterministicBase, Unnamed, DrawsNothing] = Field(
        default=Constant(), description="a deterministic policy; by default constant, with the action 0"
    )
    beta: Annotated[float, Field(ge=0.0, le=4.0, strict=True), AfterValidator(lambda x: x + 0.0)] = Field(
        default=1.0, description="β, the exponent of the spectrum"
    )
    scale: Annotated[float, Field(ge=1e-9, le=1e9, strict=True)] = Field(
        default=0.5, description="standard deviation of the noise"
    )
    period: Annotated[int, Field(ge=2, le=4096, strict=True), AfterValidator(_power_of_two)] = Field(
        default=1024, description="steps after which the noise repeats itself, a power of two"
    )

    @property
    def own_needs(self) -> Needs:
        """Draws for the sines of each number of the action; it remembers the noise of the whole episode."""
        return Needs(history=0, episode_draws=3 * self.period, memory=3 * self.period)

    def decide(self, observed: Observed) -> Decision:
        (base, memory), process = self.base_action(observed), self.beyond_base(observed)
        noise = process.memory
        if (observed.step == 0).any():
            noise = noise.copy()
            _draw(observed.step, process.episode_uniforms, self.beta, noise)
        action = _with_noise(base, noise, observed.step, self.scale)
        return Decision(action, np.concatenate([memory, noise], axis=1))


@compiled
def _with_noise(base: Float32s, noise: Floats, step: Steps, scale: float) -> Floats:
    period = noise.shape[1] // 3
    out = np.empty((noise.shape[0], 3))
    for i in range(noise.shape[0]):
        for j in range(3):
            out[i, j] = np.float64(base[i, j]) + scale * noise[i, j * period + step[i] % period]
    return out


@compiled
def _draw(step: Steps, u: Floats, beta: float, noise: Floats) -> None:
    """Write the noise of the episodes that are at step 0 into noise (n, 3 · period), from u of that shape."""
    period = noise.shape[1] // 3
    half = period // 2
    weights = np.zeros(half + 1)
    total = 0.0
    for k in range(1, half + 1):
        weights[k] = pow(np.float64(k), -0.5 * beta)
        total += weights[k] * weights[k]
    for k in range(1, half + 1):
        weights[k] /= np.sqrt(total)
    cosines, sines = np.empty(half), np.empty(half)
    for k in range(half):
        cosines[k], sines[k] = cosine(k / period), sine(k / period)
    real, imaginary = np.empty(period), np.empty(period)
    for i in range(noise.shape[0]):
        if step[i] == 0:
            for j in range(3):
                draws = u[i, j * period : (j + 1) * period]
                for k in range(period):
                    real[k], imaginary[k] = 0.0, 0.0
                for k in range(1, half):
                    real[k] = weights[k] * standard_normal(draws[2 * k])
                    imaginary[k] = -weights[k] * standard_normal(draws[2 * k + 1])
                real[half] = weights[half] * standard_normal(draws[1])
                transform(real, imaginary, cosines, sines)
                for t in range(period):
                    noise[i, j * period + t] = real[t]


@compiled
def transform(real: Floats, imaginary: Floats, cosines: Floats, sines: Floats) -> None:
    """Replace c_k by Σ_k c_k e^(2πikt/N), for t = 0 … N - 1, in place; N is a power of two.

    The fast Fourier transform of Cooley and Tukey 1965, in a fixed order. The cosines and sines are those of
    2πk/N for k < N/2.
    """
    n = real.shape[0]
    j = 0
    for i in range(1, n):  # the order of reversed bits
        bit = n >> 1
        while j & bit:
            j ^= bit
            bit >>= 1
        j |= bit
        if i < j:
            real[i], real[j] = real[j], real[i]
            imaginary[i], imaginary[j] = imaginary[j], imaginary[i]
    half = 1
    while half < n:
        stride = n // (2 * half)
        for start in range(0, n, 2 * half):
            for k in range(half):
                c, s = cosines[k * stride], sines[k * stride]
                a, b = start + k, start + k + half
                x = real[b] * c - imaginary[b] * s
                y = real[b] * s + imaginary[b] * c
                real[b], imaginary[b] = real[a] - x, imaginary[a] - y
                real[a], imaginary[a] = real[a] + x, imaginary[a] + y
        half *= 2


class Sticky(Wrapper):
    """Repeats the last action with probability κ; else, and at the first step, the base acts.

    An action is held for 1/(1 - κ) steps on average. Source: Machado et al. 2018, Revisiting the Arcade
    Learning Environment, where sticky actions belong to the environment.
    """

    own_needs: ClassVar[Needs] = Needs(history=1, step_draws=1)

    kind: Literal["sticky"] = "sticky"
    base: Annotated[AnyPolicy, Unnamed] = Field(description="the policy whose actions are repeated")
    kappa: Probability = Field(description="probability of repeating the last action, in [0, 1]")

    def decide(self, observed: Observed) -> Decision:
        base, memory = self.base_distribution(observed)
        kappa = np.where(observed.step > 0, self.kappa, 0.0)  # at the first step there is nothing to repeat
        last = Certain(observed.actions[:, 0])
        return Decision(OrCertain(kappa, base, last, first=self.base.needs.step_draws), memory)
