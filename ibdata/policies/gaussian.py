"""A base policy with normal noise on its action."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from ibdata.numerics.compiled import compiled
from ibdata.numerics.exact import exp, log
from ibdata.numerics.random import standard_normal
from ibdata.policies.base import Decision, Float32s, Floats, Needs, Observed
from ibdata.policies.wrapper import Certain, Unnamed, Wrapper

if TYPE_CHECKING:
    from ibdata.policies import DeterministicBase

CLIP_EDGE = 1.0 - 2.0**-25  # float32 rounds numbers from here on to 1
LOG_SQRT_2PI = float.fromhex("0x1.d67f1c864beb5p-1")
FAR = 3.0  # |z| from which a continued fraction replaces the series
TERMS = 60  # of either


class Gaussian(Wrapper):
    """Adds N(0, scale²) to each number of the base's action, and clips the sum to [-1, 1].

    The base must be deterministic, because a random base would give no simple density.
    """

    own_needs: ClassVar[Needs] = Needs(history=0, step_draws=3)

    kind: Literal["gaussian"] = "gaussian"
    base: Annotated[DeterministicBase, Unnamed, Certain] = Field(description="a deterministic policy")
    scale: Annotated[float, Field(ge=1e-9, le=1e9, strict=True)] = Field(
        description="standard deviation of the noise"
    )

    def decide(self, given: Observed) -> Decision:
        base, memory = self.base_action(given)
        return Decision(_with_noise(base, self.own(given).uniforms, self.scale), memory)

    def log_density(self, given: Observed, action: Float32s) -> Floats:
        """The log density (n,): normal inside (-1, 1), with the clipped mass at ±1."""
        return log_clipped_normal(self.base_action(given)[0], action, self.scale)


@compiled
def _with_noise(base: Float32s, u: Floats, scale: float) -> Floats:
    out = np.empty((base.shape[0], 3))
    for i in range(out.shape[0]):
        for j in range(3):
            out[i, j] = np.float64(base[i, j]) + scale * standard_normal(u[i, j])
    return out


@compiled
def log_clipped_normal(own: npt.NDArray[np.floating[Any]], action: Float32s, scale: float) -> Floats:
    """The log densities (n,) of N(own, scale²), clipped to [-1, 1], at actions (n, 3)."""
    out = np.empty(action.shape[0])
    log_height = -log(scale) - LOG_SQRT_2PI
    for i in range(out.shape[0]):
        total = 0.0
        for j in range(3):
            mean, x = np.float64(own[i, j]), np.float64(action[i, j])
            if x >= 1.0:
                total += log_cdf((mean - CLIP_EDGE) / scale)
            elif x <= -1.0:
                total += log_cdf((-mean - CLIP_EDGE) / scale)
            else:
                total += log_height - 0.5 * ((x - mean) / scale) * ((x - mean) / scale)
        out[i] = total
    return out


@compiled
def log_cdf(z: float) -> float:
    """Logarithm of the normal distribution function Φ(z), to 1e-12 relative or 1e-16 absolute.

    >>> float(log_cdf(0.0)) == float(log(0.5)), float(log_cdf(100.0))
    (True, 0.0)
    """
    x = abs(z)
    log_density = -0.5 * x * x - LOG_SQRT_2PI
    if x >= FAR:
        log_tail = log_density + log(_mills(x))
        return log_tail if z < 0.0 else log(1.0 - exp(log_tail))
    middle = exp(log_density) * _series(x)  # Φ(x) - ½
    return log(0.5 - middle) if z < 0.0 else log(0.5 + middle)


@compiled
def _series(x: float) -> float:
    """(Φ(x) - ½) / φ(x) = x + x³/3 + x⁵/(3·5) + …, for |x| <= 3."""
    term = total = x
    for k in range(1, TERMS):
        term = term * (x * x) / (2.0 * k + 1.0)
        total += term
    return total


@compiled
def _mills(x: float) -> float:
    """(1 - Φ(x)) / φ(x) = 1/(x + 1/(x + 2/(x + 3/(x + …)))), for x >= 3 (Laplace)."""
    down = x
    for k in range(TERMS, 0, -1):
        down = x + k / down
    return 1.0 / down
