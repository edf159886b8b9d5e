"""Rewards and costs of a view.

Rewards are computed from consumption and fatigue: with other weights, or as the change since the step before.
A cost beside the reward, for safe reinforcement learning, is 1 for a step into a dangerous state, else 0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arrays import Float32s, Floats
from ibdata.errors import UsageError, suggestion
from ibdata.views.variables import AMPLIFICATION_START

PAID_BY = ("consumption", "fatigue")
REWARD_KINDS = ("classic", "delta")
COST_KINDS = ("fatigue", "runaway")
COST_EXPECTED = "{fatigue: 60}, runaway, or a mapping with a budget too, such as {fatigue: 60, budget: 25}"


@dataclass(frozen=True)
class Reward:
    """A reward: "classic", "delta" or "weights". The reward of the benchmark has the weights 1 and 3."""

    kind: str = "classic"
    consumption: float = 1.0
    fatigue: float = 3.0

    def plain(self) -> Any:
        """The reward as users give it."""
        return {name: getattr(self, name) for name in PAID_BY} if self.kind == "weights" else self.kind

    def cost(self, consumption: Float32s, fatigue: Float32s) -> Floats:
        """The weighted cost of states with these consumptions and fatigues (n,)."""
        return self.consumption * consumption.astype(np.float64) + self.fatigue * fatigue.astype(np.float64)

    def of(self, before: Sequence[Float32s], after: Sequence[Float32s], scale: float) -> Float32s:
        """The scaled rewards of n steps, computed in float64 from float32 values and rounded once.

        `before` and `after` are consumption and fatigue at t and at t + 1, (n,) each. Raises UsageError if a
        reward is too large for float32.
        """
        rewards = -self.cost(*after)
        if self.kind == "delta":
            rewards += self.cost(*before)
        return rounded(rewards, scale)


CLASSIC = Reward()


def rounded(rewards: npt.NDArray[Any], scale: float) -> Float32s:
    """Rewards times a scale. Raises UsageError if they are not finite as float32."""
    product = rewards.astype(np.float64) * scale
    if not (np.abs(product) <= np.finfo(np.float32).max).all():
        raise UsageError(f"reward: found weights or a scale ({scale}) that make rewards infinite")
    return product.astype(np.float32)


def scaled(rewards: npt.NDArray[Any], scale: float) -> npt.NDArray[Any]:
    """Classic rewards times a scale. The scale 1 leaves them as they are; others round float32 rewards."""
    return rewards if scale == 1 else rounded(rewards.astype(np.float32), scale)


def reward_of(reward: Any) -> Reward:
    """Check the reward of a user. Raises UsageError if it is not valid."""
    if isinstance(reward, str) and reward in REWARD_KINDS:
        return Reward(reward)
    if isinstance(reward, Mapping):
        return _weighted(reward)
    hint = suggestion(reward, REWARD_KINDS) if isinstance(reward, str) else ""
    expected = "classic, delta or weights such as {consumption: 1, fatigue: 3}"
    raise UsageError(f"reward: found {reward!r}, expected {expected}{hint}")


def _weighted(weights: Mapping[Any, Any]) -> Reward:
    """The reward with these weights of the costs."""
    if not weights:
        raise UsageError("reward: found no weight, expected some such as {consumption: 1, fatigue: 3}")
    for name, weight in weights.items():
        if name not in PAID_BY:
            hint = suggestion(str(name), PAID_BY)
            raise UsageError(f"reward: found {name!r}, expected weights of consumption and fatigue{hint}")
        if not math.isfinite(weight):
            raise UsageError(f"reward: {name}: found {weight!r}, expected a finite number")
    return Reward("weights", *(float(weights.get(name, 0.0)) for name in PAID_BY))


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
    near = suggestion(cost, COST_KINDS) if isinstance(cost, str) else ""
    raise UsageError(f"cost: found {cost!r}, expected {COST_EXPECTED}{near}")


def _number(name: str, value: Any) -> float:
    """A finite number of at least 0."""
    number = float(value) if isinstance(value, Real) and not isinstance(value, bool) else math.nan
    if not 0 <= number < math.inf:
        raise UsageError(f"cost: {name}: found {value!r}, expected a finite number of at least 0")
    return number
