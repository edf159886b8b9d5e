"""Rewards computed from consumption and fatigue: other weights, or the change since the step before."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.errors import UsageError, suggestion

Float32s = npt.NDArray[np.float32]
Floats = npt.NDArray[np.float64]
COSTS = ("consumption", "fatigue")
KINDS = ("classic", "delta")


@dataclass(frozen=True)
class Reward:
    """A reward: "classic", "delta" or "weights". The reward of the benchmark has the weights 1 and 3."""

    kind: str = "classic"
    consumption: float = 1.0
    fatigue: float = 3.0

    def plain(self) -> Any:
        """The reward as users give it."""
        return {name: getattr(self, name) for name in COSTS} if self.kind == "weights" else self.kind

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
    if isinstance(reward, str) and reward in KINDS:
        return Reward(reward)
    if isinstance(reward, Mapping):
        return _weighted(reward)
    hint = suggestion(reward, KINDS) if isinstance(reward, str) else ""
    expected = "classic, delta or weights such as {consumption: 1, fatigue: 3}"
    raise UsageError(f"reward: found {reward!r}, expected {expected}{hint}")


def _weighted(weights: Mapping[Any, Any]) -> Reward:
    """The reward with these weights of the costs."""
    if not weights:
        raise UsageError("reward: found no weight, expected some such as {consumption: 1, fatigue: 3}")
    for name, weight in weights.items():
        if name not in COSTS:
            hint = suggestion(str(name), COSTS)
            raise UsageError(f"reward: found {name!r}, expected weights of consumption and fatigue{hint}")
        if not math.isfinite(weight):
            raise UsageError(f"reward: {name}: found {weight!r}, expected a finite number")
    return Reward("weights", *(float(weights.get(name, 0.0)) for name in COSTS))
