"""Costs beside the reward, for safe reinforcement learning: 1 for a step into a dangerous state, else 0."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.errors import UsageError, suggestion
from ibdata.variables import AMPLIFICATION_START

Float32s = npt.NDArray[np.float32]
KINDS = ("fatigue", "runaway")
EXPECTED = "{fatigue: 60}, runaway, or a mapping with a budget too, such as {fatigue: 60, budget: 25}"


@dataclass(frozen=True)
class Cost:
    """A cost of the state that follows a step.

    The kind "fatigue" costs 1 where the fatigue is above the limit, the kind "runaway" where a hidden μ is
    at least 1.2, from where it grows by itself. An episode whose costs add up to more violates the budget.
    """

    kind: str
    limit: float = AMPLIFICATION_START
    budget: float = 0.0

    @property
    def variables(self) -> tuple[str, ...]:
        """The columns of a state from which its cost follows."""
        return ("obs_fatigue",) if self.kind == "fatigue" else ("latent_mu_v", "latent_mu_g")

    def of(self, values: Sequence[npt.NDArray[Any]]) -> Float32s:
        """The costs (n,) of states, from their variables (n,) as a dataset holds them."""
        highest = np.max([np.float32(column) for column in values], axis=0)
        limit = np.float32(self.limit)
        dangerous: npt.NDArray[np.bool_] = highest > limit if self.kind == "fatigue" else highest >= limit
        return dangerous.astype(np.float32)

    def plain(self) -> dict[str, Any]:
        """The cost as users give it."""
        return {self.kind: self.limit if self.kind == "fatigue" else True, "budget": self.budget}


def cost_of(cost: Any) -> Cost | None:
    """Check the cost of a user. Raises UsageError if it is not valid."""
    match {"budget": 0.0, **cost} if isinstance(cost, Mapping) else cost:
        case None:
            return None
        case "runaway":
            return Cost("runaway")
        case {"fatigue": limit, "budget": budget, **others} if not others:
            return Cost("fatigue", _number("fatigue", limit), _number("budget", budget))
        case {"runaway": True, "budget": budget, **others} if not others:
            return Cost("runaway", budget=_number("budget", budget))
    near = suggestion(cost, KINDS) if isinstance(cost, str) else ""
    raise UsageError(f"cost: found {cost!r}, expected {EXPECTED}{near}")


def _number(name: str, value: Any) -> float:
    """A finite number of at least 0."""
    number = float(value) if isinstance(value, Real) and not isinstance(value, bool) else math.nan
    if not 0 <= number < math.inf:
        raise UsageError(f"cost: {name}: found {value!r}, expected a finite number of at least 0")
    return number
