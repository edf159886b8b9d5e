"""Actions of a base that other ones replace with a probability: how they are drawn, and their density."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arrays import Bools, Float32s, Floats
from ibdata._numerics.compiled import compiled
from ibdata._numerics.exact import exp, log
from ibdata.policies.distributions import Certain, Distribution, applied, log_uniform


class Replaced(Distribution):
    """The action of a base, clipped and rounded, which is replaced as a whole with a probability, the share.

        p = (1 - share) p_base + share p_other

    Atoms and densities do not add: where only one of the two has an atom, the other counts nothing.

    Args:
        share: The probability in each episode, (n,).
        base: The distribution of the base's actions.
        first: How many of the random numbers come before this one's own: those of the base's policy.
    """

    def __init__(self, share: Floats, base: Distribution, first: int) -> None:
        self.share, self.base, self.first = share, base, first

    def base_sample(self, u: Floats) -> Float32s:
        """Actions (n, 3) of the base."""
        if isinstance(self.base, Certain):
            return self.base.applied
        return applied(self.base.sample(np.ascontiguousarray(u[:, : self.first])))


class OrUniform(Replaced):
    """The action of a base, which U(-1, 1)³ replaces with a probability, see `Replaced`.

    >>> half = OrUniform(np.array([0.5]), Certain(np.zeros((1, 3))), first=0)
    >>> np.exp(half.log_density(np.zeros((1, 3), dtype=np.float32))).tolist()
    [0.5]
    >>> np.exp(half.log_density(np.full((1, 3), 0.25, dtype=np.float32))).tolist()
    [0.0625]
    """

    def __init__(self, share: Floats, base: Distribution, first: int) -> None:
        super().__init__(share, base, first)
        self.draws = first + 4  # one that decides, three for the action

    def sample(self, u: Floats) -> Floats:
        return _base_or_uniform(self.base_sample(u), np.ascontiguousarray(u[:, self.first :]), self.share)

    def log_density(self, action: Float32s) -> Floats:
        density = self.base.log_density(action)
        certain = density == 0.0 if isinstance(self.base, Certain) else self.base.certain(action)
        return _log_or_uniform(density, certain, action, self.share)

    def atoms(self, action: Float32s) -> Bools:
        return self.base.atoms(action) & (self.share < 1.0)[:, None]


class OrCertain(Replaced):
    """The action of a base, which a certain one replaces with a probability, see `Replaced`.

    Args:
        other: The certain actions.
    """

    def __init__(self, share: Floats, base: Distribution, other: Certain, first: int) -> None:
        super().__init__(share, base, first)
        self.other = other
        self.draws = first + 1

    def sample(self, u: Floats) -> npt.NDArray[Any]:
        is_other = u[:, self.first] < self.share
        return np.where(is_other[:, None], self.other.actions, self.base_sample(u))

    def log_density(self, action: Float32s) -> Floats:
        density, certain = self.base.log_density(action), self.base.certain(action)
        return _log_or_certain(density, certain, self._is_other(action), self.share)

    def atoms(self, action: Float32s) -> Bools:
        return self._is_other(action)[:, None] | self.base.atoms(action)

    def _is_other(self, action: Float32s) -> Bools:
        """Whether actions may be the certain ones, (n,)."""
        return self.other.certain(action) & (self.share > 0.0)


@compiled
def _base_or_uniform(base: Float32s, u: Floats, share: Floats) -> Floats:
    """Actions (n, 3) of a base, replaced as a whole by U(-1, 1)³ with a probability, by numbers u (n, 4)."""
    out = np.empty((base.shape[0], 3))
    for i in range(out.shape[0]):
        for j in range(3):
            out[i, j] = 2.0 * u[i, 1 + j] - 1.0 if u[i, 0] < share[i] else np.float64(base[i, j])
    return out


@compiled
def log_share(x: float) -> float:
    """Logarithm of a share, -inf if it is 0."""
    return log(x) if x > 0.0 else -np.inf


@compiled
def _log_or_uniform(base: Floats, certain: Bools, action: Float32s, shares: Floats) -> Floats:
    """The log densities (n,) of a base's actions that U(-1, 1)³ replaces with a probability; NaN stays.

        log((1 - share) b + share u), with the densities b of the base and u of U(-1, 1)³

    Where the base is certain of the whole action, u has no mass there, and the result is log((1 - share) b).
    """
    out = np.empty(base.shape[0])
    share, log_kept, log_random = -1.0, 0.0, 0.0
    for i in range(out.shape[0]):
        out[i] = base[i]
        if np.isnan(base[i]) or shares[i] == 0.0:
            continue
        if shares[i] != share:
            share, log_kept, log_random = shares[i], log_share(1.0 - shares[i]), log(shares[i])
        a, b = log_kept + base[i], log_random + log_uniform(action, i)
        inside = min(abs(action[i, 0]), abs(action[i, 1]), abs(action[i, 2])) < 1.0
        if certain[i] and inside and share < 1.0:
            out[i] = a
        elif a == -np.inf:
            out[i] = b
        else:
            out[i] = max(a, b) + log(1.0 + exp(min(a, b) - max(a, b)))
    return out


@compiled
def _log_or_certain(base: Floats, certain: Bools, is_other: Bools, share: Floats) -> Floats:
    """The log densities (n,) of a base's actions that are replaced by a certain one with a probability.

    It is log(1 - share) more than the base's, except at the certain action: there it is
    log(share + (1 - share) p) if the base takes it with a probability p, else log share. NaN stays.
    """
    out = base.copy()
    for i in range(out.shape[0]):
        if np.isnan(out[i]) or not is_other[i]:
            out[i] += log_share(1.0 - share[i])
        else:
            out[i] = log(share[i] + ((1.0 - share[i]) * exp(out[i]) if certain[i] else 0.0))
    return out
