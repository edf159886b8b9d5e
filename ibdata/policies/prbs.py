"""Pseudo-random binary signals, which excite a system for its identification."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from ibdata.policies.base import Decision, Deterministic, Floats, Needs, Observed

# The bits of a shift register of that many bits whose parity is shifted in, for the longest period: exponents
# of primitive polynomials over GF(2), as in Peterson and Weldon 1972, Error-Correcting Codes, appendix C.
TAPS = {
    2: (2, 1), 3: (3, 2), 4: (4, 3), 5: (5, 3), 6: (6, 5), 7: (7, 6), 8: (8, 6, 5, 4), 9: (9, 5), 10: (10, 7),
    11: (11, 9), 12: (12, 11, 10, 4),
}  # fmt: skip
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
    order: Annotated[int, Field(ge=2, le=12, strict=True)] = Field(
        default=8, description="bits of the shift register; the sequence has 2^order - 1 bits"
    )
    hold: Annotated[int, Field(ge=1, le=1000, strict=True)] = Field(
        default=4, description="steps for which a bit is held"
    )
    amplitude: Amplitude = Field(default=1.0, description="the size of each number of the action")

    def decide(self, observed: Observed) -> Decision:
        signs = sequence(self.order)
        length = len(signs)
        place = np.floor(observed.episode_uniforms[:, 0] * (length * self.hold)).astype(np.int64)
        bit = (place + observed.step) // self.hold
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
