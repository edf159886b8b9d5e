"""Uniform random exploration."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from ibdata.numerics.compiled import compiled, inlined
from ibdata.policies.base import Bools, Decision, Float32s, Floats, Needs, Observed, Policy

LOG_HALF = float.fromhex("-0x1.62e42fefa39efp-1")  # log(1/2), the log density of U(-1, 1)
LOG_EIGHTH = float.fromhex("-0x1.0a2b23f3bab73p+1")  # log(1/8), that of U(-1, 1)³
# log 2⁻²⁶, the share of U(-1, 1) that float32 rounds to 1, and as much to -1
LOG_MASS_AT_EDGE = float.fromhex("-0x1.205966f2b4f12p+4")
LOG_EDGE_TO_INSIDE = LOG_MASS_AT_EDGE - LOG_HALF


class Random(Policy):
    """Draws each number of the action uniformly from [-1, 1], the paper's random exploration.

    Source: Hein et al. 2017, section "Experimental Prototypes".
    """

    needs: ClassVar[Needs] = Needs(history=0, step_draws=3)

    kind: Literal["random"] = "random"

    def decide(self, given: Observed) -> Decision:
        return Decision(2.0 * given.uniforms - 1.0, given.memory)

    def log_density(self, given: Observed, action: Float32s) -> Floats:
        return _log_density(action)

    def atoms(self, given: Observed, action: Float32s) -> Bools:
        """None: the numbers that float32 rounds to ±1 are those of a density."""
        return np.zeros(action.shape, dtype=np.bool_)


@compiled
def _log_density(action: Float32s) -> Floats:
    out = np.empty(action.shape[0])
    for i in range(action.shape[0]):
        out[i] = log_uniform(action, i)
    return out


@inlined
def log_uniform(action: Float32s, i: int) -> float:
    """Log density of U(-1, 1)³ at row i, with masses at ±1 because float32 rounds to them."""
    edges = 0
    for j in range(3):
        edges += abs(action[i, j]) == 1.0
    return LOG_EIGHTH + LOG_EDGE_TO_INSIDE * edges
