"""Sums of sines, which excite a system at chosen frequencies for its identification."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, ClassVar, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from ibdata.numerics.circle import cosine
from ibdata.numerics.compiled import compiled
from ibdata.policies.base import Deterministic, Floats
from ibdata.policies.given import Decision, Given
from ibdata.policies.prbs import Amplitude


class Multisine(Deterministic):
    """Moves each steering by a sum of K sines of equal power, with few high peaks.

        x_j[t] ∝ Σ_i cos(2π (3i + j - 3) t/N - π i (i - 1)/K),    i = 1 … K,    j = 1, 2, 3

    The highest peak of x_j is the `amplitude`. The three numbers of the action have different frequencies, so
    they are uncorrelated over a period of N steps. An episode begins at a random time of the period; given
    this time, its actions have the probability 1. Sources: Schroeder 1970, Synthesis of low-peak-factor
    signals; Ljung 1999, System Identification, chapter 13.
    """

    history_length: ClassVar[int] = 0
    uniforms_per_episode: ClassVar[int] = 1

    kind: Literal["multisine"] = "multisine"
    sines: Annotated[int, Field(ge=1, le=1000, strict=True)] = Field(
        default=10, description="K, the number of sines of each number of the action"
    )
    period: Annotated[int, Field(ge=8, le=10_000, strict=True)] = Field(
        default=1000, description="N, the steps of a period; more than 6 K"
    )
    amplitude: Amplitude = Field(default=1.0, description="the highest peak")

    def decide(self, given: Given) -> Decision:
        place = np.floor(given.episode_uniforms[:, 0] * self.period).astype(np.int64)
        signals = waves(self.sines, self.period)
        return Decision(self.amplitude * signals[(place + given.step) % self.period], given.memory)

    @model_validator(mode="after")
    def _check(self) -> Multisine:
        if self.period <= 6 * self.sines:
            raise ValueError(
                f"found a period of {self.period} steps, expected more than {6 * self.sines}, which is 6 for "
                "each of the sines"
            )
        return self


@lru_cache
def waves(sines: int, period: int) -> npt.NDArray[np.float64]:
    """The three signals (period, 3), with the highest peak 1."""
    out = np.empty((period, 3))
    _waves(sines, out)
    out.flags.writeable = False
    return out


@compiled
def _waves(sines: int, out: Floats) -> None:
    period = out.shape[0]
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
