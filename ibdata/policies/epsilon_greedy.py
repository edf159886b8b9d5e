"""A base policy whose action is replaced by a random one now and then."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, Field, model_validator

from ibdata.numerics.compiled import compiled
from ibdata.numerics.exact import exp, log
from ibdata.policies.base import Floats, NormalDouble, is_deterministic
from ibdata.policies.given import Decision, Given
from ibdata.policies.random import LOG_DENSITY, LOG_EDGE
from ibdata.policies.support import INSIDE, Support, each
from ibdata.policies.wrapper import Unnamed, Wrapper

if TYPE_CHECKING:
    from ibdata.policies import AnyBase

THIRD = LOG_DENSITY / 3.0  # log(1/2), the density of one dimension

Probability = Annotated[
    float,
    Field(ge=0.0, le=1.0, strict=True, allow_inf_nan=False),
    NormalDouble,
    AfterValidator(lambda value: value + 0.0),
]


class EpsilonGreedy(Wrapper):
    """Replaces the base's action with probability ε at each step by one drawn from U(-1, 1)³.

    The whole action is replaced or, with `per_dimension`, each of its three numbers independently. In
    `siemens-research/lion`, generate_data.py replaces the whole action in its toy environment; we infer that
    the published Industrial Benchmark data were made in the same way.
    """

    kind: Literal["epsilon_greedy"] = "epsilon_greedy"
    base: Annotated[AnyBase, Unnamed] = Field(description="the policy whose actions are replaced")
    epsilon: Probability = Field(description="probability of a random action, in [0, 1]")
    per_dimension: bool = Field(
        default=False, strict=True, description="replace each of the three numbers independently"
    )

    @property
    def own_uniforms_per_step(self) -> int:  # type: ignore[override]  # read from instances only
        """One or three draws that decide, and three for the random action."""
        return 6 if self.per_dimension else 4

    @property
    def is_short(self) -> bool:
        """Whether that is true of the base."""
        return self.base.is_short

    def decide(self, given: Given) -> Decision:
        base, memory = self.base_action(given)
        action = np.empty(base.shape)
        _act(base, self.own(given).uniforms, self.epsilon, self.per_dimension, action)
        return Decision(action, memory)

    def log_density(self, given: Given, action: npt.NDArray[np.float32]) -> Floats:
        """Return the log density (n,) of actions.

        If the base is deterministic, it is log(1 - ε) at the base's action and log(ε/8) elsewhere; with
        `per_dimension`, the sum over the three numbers of log(1 - ε) where they equal the base's and log(ε/2)
        elsewhere. If the base is random, it is the log density of the mixture.
        """
        out = np.empty(len(action))
        if is_deterministic(self.base):
            _log_prob(self.base_action(given)[0], action, self.epsilon, self.per_dimension, out)
        else:
            _log_mixture(self.base.log_density(self.for_base(given), action), action, self.epsilon, out)
        return out

    def supports(self, step: int) -> tuple[Support, ...] | None:
        base = self.base.supports(step)
        if base is None or self.epsilon == 0.0:
            return base
        if self.epsilon == 1.0:
            return (each(INSIDE),)
        if self.per_dimension:
            return tuple(each(INSIDE, *next(iter(support))[:1]) for support in base)
        return tuple(support | each(INSIDE) for support in base)

    def atoms(self, given: Given, action: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
        edges = super().atoms(given, action)
        if self.epsilon == 1.0:
            return edges
        if self.per_dimension:
            kept: npt.NDArray[np.bool_] = action == self.base_action(given)[0]
            return kept | edges
        return self.base.atoms(self.for_base(given), action) | edges

    @model_validator(mode="after")
    def _check(self) -> EpsilonGreedy:
        if self.per_dimension and not is_deterministic(self.base):
            raise ValueError(
                f"found per_dimension: true around {self.base.kind}, which is random itself; expected false"
            )
        return self


@compiled
def _act(base: npt.NDArray[np.float32], u: Floats, epsilon: float, each: bool, out: Floats) -> None:
    first = 3 if each else 1
    for i in range(out.shape[0]):
        for j in range(3):
            replaced = u[i, j if each else 0] < epsilon
            out[i, j] = 2.0 * u[i, first + j] - 1.0 if replaced else np.float64(base[i, j])


@compiled
def log_share(x: float) -> float:
    """Logarithm of a share, -inf if it is 0."""
    return log(x) if x > 0.0 else -np.inf


@compiled
def _log_uniform(action: npt.NDArray[np.float32], i: int) -> float:
    """Log density of U(-1, 1)³, with masses at ±1 because float32 rounds to them."""
    total = LOG_DENSITY
    for j in range(3):
        if abs(action[i, j]) == 1.0:
            total += LOG_EDGE
    return total


@compiled
def _log_prob(
    own: npt.NDArray[np.float32],
    action: npt.NDArray[np.float32],
    epsilon: float,
    each: bool,
    out: Floats,
) -> None:
    log_kept, log_replaced = log_share(1.0 - epsilon), log_share(epsilon)
    for i in range(out.shape[0]):
        same = 0
        total = 0.0
        for j in range(3):
            # With ε = 1 the base's action has no mass of its own.
            if action[i, j] == own[i, j] and epsilon < 1.0:
                same += 1
                total += log_kept
            else:
                total += log_replaced + THIRD + (LOG_EDGE if abs(action[i, j]) == 1.0 else 0.0)
        out[i] = total if each else log_kept if same == 3 else log_replaced + _log_uniform(action, i)


@compiled
def _log_mixture(base: Floats, action: npt.NDArray[np.float32], epsilon: float, out: Floats) -> None:
    for i in range(out.shape[0]):
        a = log_share(1.0 - epsilon) + base[i]
        b = log_share(epsilon) + _log_uniform(action, i)
        top, bottom = max(a, b), min(a, b)
        out[i] = base[i] if np.isnan(base[i]) else top + log(1.0 + exp(bottom - top))


def replaced(base: npt.NDArray[np.float32], u: Floats, epsilon: Floats) -> Floats:
    """The base's actions (n, 3), some replaced as a whole by u (n, 4), with the probabilities ε (n,)."""
    return np.where(u[:, :1] < epsilon[:, None], 2.0 * u[:, 1:] - 1.0, base)


def log_replaced(
    base: Floats, mass: npt.NDArray[np.bool_], action: npt.NDArray[np.float32], epsilon: Floats
) -> Floats:
    """The log densities (n,) of actions that `replaced` returned.

    Args:
        base: the log densities of the base (n,).
        mass: whether the base takes the whole action with a probability of its own (n,).
        action: the actions (n, 3).
        epsilon: the probabilities with which actions are replaced (n,).

    Returns:
        Log densities; the base's where ε is 0, and NaN where it is NaN.
    """
    out = base.copy()
    _log_replaced(mass & (np.abs(action) < 1.0).any(axis=1), action, epsilon, out)
    return out


@compiled
def _log_replaced(
    mass: npt.NDArray[np.bool_], action: npt.NDArray[np.float32], epsilon: Floats, out: Floats
) -> None:
    for i in range(out.shape[0]):
        if np.isnan(out[i]) or epsilon[i] == 0.0:
            continue
        a = log_share(1.0 - epsilon[i]) + out[i]
        b = log(epsilon[i]) + _log_uniform(action, i)
        if mass[i]:
            out[i] = a  # random actions have no mass there
        else:
            out[i] = max(a, b) + log(1.0 + exp(min(a, b) - max(a, b)))
