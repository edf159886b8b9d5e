"""Actions as they are applied, clipped and rounded or one of 27 discrete ones, and their distributions.

A policy's action is a float32 number in [-1, 1]³. So a density here is with respect to Lebesgue measure on
(-1, 1) plus a unit mass, an *atom*, wherever numbers of positive probability lie: at ±1, where draws are
clipped, and at the certain action of a base policy.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arrays import Bools, Float32s, Floats
from ibdata._numerics.compiled import compiled, inlined
from ibdata._numerics.exact import LOG_SQRT_2PI, log, log_cdf
from ibdata._numerics.random import standard_normal

# A discrete action changes velocity, gain and shift by -1, 0 or 1 each, in the order of the class `IBGym` of
# `industrial-benchmark-python` 2.0.
Action = tuple[float, float, float]
CHANGES = (-1.0, 0.0, 1.0)
DISCRETE: tuple[Action, ...] = tuple(product(CHANGES, CHANGES, CHANGES))  # of velocity, gain, shift
NUMBERED = f"from 0 to {len(DISCRETE) - 1}"
_TABLE = np.array(DISCRETE, dtype=np.float32)


def is_discrete(numbers: npt.NDArray[Any]) -> bool:
    """Whether an array holds whole numbers (n,), which may be discrete actions."""
    return numbers.ndim == 1 and numbers.dtype.kind in "iu"


def of_discrete(numbers: npt.NDArray[np.integer]) -> npt.NDArray[np.float32] | None:
    """The actions (n, 3) that whole numbers (n,) name; None if one of them names none."""
    inside = bool(((numbers >= 0) & (numbers < len(DISCRETE))).all())
    return _TABLE.take(numbers, axis=0) if inside else None


@compiled
def clipped_and_rounded(x: float) -> np.float32:
    """A component of an action, clipped to [-1, 1] and rounded to float32; -0.0 becomes 0.0, NaN stays."""
    bounded = 1.0 if x > 1.0 else -1.0 if x < -1.0 else x
    return np.float32(bounded) + np.float32(0.0)


@compiled
def clip_and_round(proposed: npt.NDArray[np.float64], out: npt.NDArray[np.float32]) -> int:
    """Write proposed actions (n, 3), clipped to [-1, 1] and rounded to float32, into out (n, 3).

    -0.0 becomes 0.0; NaN stays. Returns the number of rows that were clipped, or -1 - row for the first row
    that is not finite.
    """
    clipped, broken = 0, -1
    for i in range(proposed.shape[0]):
        outside = False
        for j in range(3):
            x = proposed[i, j]
            if broken < 0 and not np.isfinite(x):
                broken = i
            outside = outside or abs(x) > 1.0
            out[i, j] = clipped_and_rounded(x)
        clipped += outside
    return clipped if broken < 0 else -1 - broken


def applied(proposed: npt.ArrayLike) -> npt.NDArray[np.float32]:
    """Return proposed actions (n, 3), clipped to [-1, 1] and rounded to float32."""
    numbers = np.asarray(proposed, dtype=np.float64)
    out = np.empty(numbers.shape, dtype=np.float32)
    clip_and_round(numbers, out)
    return out


def finite_actions(proposed: npt.ArrayLike) -> npt.NDArray[np.float32] | None:
    """Actions (…, 3) that a user gave, clipped and rounded; None if they are not finite real numbers."""
    try:
        numbers = np.asarray(proposed)
        numbers = np.empty(0) if np.iscomplexobj(numbers) else numbers.astype(np.float64)
    except (TypeError, ValueError):
        return None
    if numbers.ndim == 0 or numbers.shape[-1] != 3:
        return None
    out = np.empty(numbers.shape, dtype=np.float32)
    is_finite = clip_and_round(numbers.reshape(-1, 3), out.reshape(-1, 3)) >= 0
    return out if is_finite else None


def read_only(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """The same array, which cannot be changed through it."""
    view = array.view()
    view.flags.writeable = False
    return view


LOG_HALF = float.fromhex("-0x1.62e42fefa39efp-1")  # log(1/2), the log density of U(-1, 1)
LOG_EIGHTH = float.fromhex("-0x1.0a2b23f3bab73p+1")  # log(1/8), that of U(-1, 1)³
# log 2⁻²⁶, the share of U(-1, 1) that float32 rounds to 1, and as much to -1
LOG_MASS_AT_EDGE = float.fromhex("-0x1.205966f2b4f12p+4")
LOG_EDGE_TO_INSIDE = LOG_MASS_AT_EDGE - LOG_HALF
CLIP_EDGE = 1.0 - 2.0**-25  # float32 rounds numbers from here on to 1


class Distribution(ABC):
    """The distribution of the actions of n episodes at one step.

    It must not depend on `observed.draws`, of which `sample` makes the actions: elsewhere they are 0.

    Attributes:
        draws: How many uniform random numbers a sample of one action takes.
    """

    draws: int = 0

    @abstractmethod
    def sample(self, u: Floats) -> npt.NDArray[Any]:
        """Draw actions (n, 3), not yet clipped and rounded, from `observed.draws` (n, k >= `draws`)."""

    @abstractmethod
    def log_density(self, action: Float32s) -> Floats:
        """The log density (n,) of actions (n, 3) after clipping and rounding; NaN where none is known."""

    def atoms(self, action: Float32s) -> Bools:
        """Whether each number of actions (n, 3) has a probability of its own: (n, 3), by default at ±1."""
        edges: Bools = np.abs(action) == 1.0
        return edges

    def certain(self, action: Float32s) -> Bools:
        """Whether there are atoms at all three numbers of actions, (n,)."""
        return np.asarray(self.atoms(action).all(axis=1))


class Plain(Distribution):
    """Actions that a policy returned itself, not yet clipped and rounded."""

    def __init__(self, actions: npt.NDArray[Any]) -> None:
        self.actions = actions  # (n, 3)

    def sample(self, u: Floats) -> npt.NDArray[Any]:
        return self.actions


class Certain(Plain):
    """Actions of which a policy is certain: each has the probability 1.

    >>> same = Certain(np.array([[0.5, 0.0, -2.0]]))
    >>> same.log_density(np.array([[0.5, 0.0, -1.0]], dtype=np.float32)).tolist()
    [0.0]
    """

    @cached_property
    def applied(self) -> Float32s:
        """The actions, clipped and rounded."""
        return applied(self.actions)

    def log_density(self, action: Float32s) -> Floats:
        _refuse_other_shape(self.applied.shape, action.shape, "certain actions")
        return log_certain(self.applied, action)

    def atoms(self, action: Float32s) -> Bools:
        return np.repeat(self.certain(action)[:, None], 3, axis=1)

    def certain(self, action: Float32s) -> Bools:
        return np.asarray(self.log_density(action) == 0.0)


class Unknown(Plain):
    """Actions of an unknown distribution: their density is NaN."""

    def log_density(self, action: Float32s) -> Floats:
        return np.full(len(action), np.nan)


class Uniform(Distribution):
    """U(-1, 1) for each number of an action: log p = log 1/8. Numbers that float32 rounds to ±1 are no atoms.

    >>> Uniform().log_density(np.zeros((1, 3), dtype=np.float32)).round(4).tolist()
    [-2.0794]
    """

    draws = 3

    def sample(self, u: Floats) -> Floats:
        return 2.0 * u[:, :3] - 1.0

    def log_density(self, action: Float32s) -> Floats:
        return _log_uniform(action)

    def atoms(self, action: Float32s) -> Bools:
        return np.zeros(action.shape, dtype=np.bool_)


class ClippedNormal(Distribution):
    """N(mean, sd²) for each number of an action, clipped to [-1, 1].

        log p(a) = log φ((a - mean)/sd) - log sd   inside (-1, 1);   log Φ((±mean - 1)/sd)   at ±1

    Args:
        mean: (n, 3).
        sd: The standard deviation, above 0: a number, or one for each episode (n, 1), for each number of an
            action (3,), or both (n, 3). Below 1e-5, float32 is too coarse for the density.

    Raises:
        ValueError: mean or sd has another shape, or a standard deviation is not above 0.

    >>> normal = ClippedNormal(np.zeros((1, 3)), 1.0)
    >>> normal.sample(np.full((1, 3), 0.5)).tolist()
    [[0.0, 0.0, 0.0]]
    >>> normal.log_density(np.array([[0.0, 0.0, 1.0]], dtype=np.float32)).round(3).tolist()
    [-3.679]
    """

    draws = 3

    def __init__(self, mean: npt.ArrayLike, sd: npt.ArrayLike) -> None:
        self.mean, sd = np.ascontiguousarray(mean, dtype=np.float64), np.asarray(sd, dtype=np.float64)
        _refuse_other_shape(self.mean.shape, (len(self.mean), 3), "means")
        if not sd.min() > 0.0:
            raise ValueError(f"found the standard deviation {sd.min()}, expected a number above 0")
        try:
            self.sd = np.ascontiguousarray(np.broadcast_to(sd, self.mean.shape))
        except ValueError:
            expected = f"a number, (n, 1), (3,) or (n, 3), where n is {len(self.mean)}"
            raise ValueError(f"found deviations of shape {sd.shape}, expected {expected}") from None

    def sample(self, u: Floats) -> Floats:
        _refuse_other_shape(self.mean.shape, (len(u), 3), "means")
        return _normal(self.mean, self.sd, np.ascontiguousarray(u[:, :3]))

    def log_density(self, action: Float32s) -> Floats:
        _refuse_other_shape(self.mean.shape, action.shape, "means")
        return _log_clipped_normal(self.mean, self.sd, action)


class Group(NamedTuple):
    """Some of n episodes, and the distribution in them."""

    episodes: npt.NDArray[np.intp]
    distribution: Distribution
    draws: int  # random numbers of its policy


class ByRow(Distribution):
    """Another distribution in each of several groups of episodes. Their actions are clipped and rounded."""

    def __init__(self, groups: Sequence[Group], draws: int) -> None:
        self.groups, self.draws = groups, draws

    def sample(self, u: Floats) -> Float32s:
        actions = np.empty((len(u), 3), dtype=np.float32)
        for episodes, distribution, draws in self.groups:
            actions[episodes] = applied(distribution.sample(u[episodes, :draws]))
        return actions

    def log_density(self, action: Float32s) -> Floats:
        out = np.empty(len(action))
        for episodes, distribution, _ in self.groups:
            out[episodes] = distribution.log_density(action[episodes])
        return out

    def atoms(self, action: Float32s) -> Bools:
        out = np.empty(action.shape, dtype=np.bool_)
        for episodes, distribution, _ in self.groups:
            out[episodes] = distribution.atoms(action[episodes])
        return out


def _refuse_other_shape(shape: tuple[int, ...], expected: tuple[int, ...], what: str) -> None:
    """Raise ValueError before compiled code reads beyond an array."""
    if shape != expected:
        raise ValueError(f"found {what} of shape {shape}, expected {expected}")


@compiled
def log_certain(certain: Float32s, action: Float32s) -> Floats:
    """The log probabilities (n,) of actions (n, 3) under a policy that takes certain ones."""
    out = np.empty(action.shape[0])
    for i in range(action.shape[0]):
        same = True
        for j in range(3):
            same = same and action[i, j] == certain[i, j]
        out[i] = 0.0 if same else -np.inf
    return out


@compiled
def _log_uniform(action: Float32s) -> Floats:
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


@compiled
def _normal(mean: Floats, sd: Floats, u: Floats) -> Floats:
    out = np.empty((mean.shape[0], 3))
    for i in range(out.shape[0]):
        for j in range(3):
            out[i, j] = mean[i, j] + sd[i, j] * standard_normal(u[i, j])
    return out


@compiled
def _log_clipped_normal(mean: Floats, sd: Floats, action: Float32s) -> Floats:
    out = np.empty(action.shape[0])
    scale, log_height = 0.0, 0.0
    for i in range(out.shape[0]):
        total = 0.0
        for j in range(3):
            if sd[i, j] != scale:
                scale = sd[i, j]
                log_height = -log(scale) - LOG_SQRT_2PI
            m, x = mean[i, j], np.float64(action[i, j])
            if x >= 1.0:
                total += log_cdf((m - CLIP_EDGE) / scale)
            elif x <= -1.0:
                total += log_cdf((-m - CLIP_EDGE) / scale)
            else:
                total += log_height - 0.5 * ((x - m) / scale) * ((x - m) / scale)
        out[i] = total
    return out
