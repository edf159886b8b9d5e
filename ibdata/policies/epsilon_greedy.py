"""A base policy whose action is replaced by a random one now and then."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, Field, model_validator

from ibdata.numerics.compiled import compiled
from ibdata.numerics.exact import exp, log
from ibdata.policies.actions import applied
from ibdata.policies.base import Floats, NormalDouble, is_deterministic
from ibdata.policies.given import Decision, Given
from ibdata.policies.random import LOG_DENSITY, LOG_EDGE
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

    def decide(self, given: Given) -> Decision:
        chosen = self.base.decide(self.for_base(given))
        base = applied(chosen.actions)
        action = np.empty(base.shape)
        _act(base, self.own(given).uniforms, self.epsilon, self.per_dimension, action)
        return Decision(action, chosen.memory)

    def log_density(self, given: Given, action: npt.NDArray[np.float32]) -> Floats:
        """Return the log density (n,) of actions.

        If the base is deterministic, it is log(1 - ε) at the base's action and log(ε/8) elsewhere; with
        `per_dimension`, the sum over the three numbers of log(1 - ε) where they equal the base's and log(ε/2)
        elsewhere. If the base is random, it is the log density of the mixture.
        """
        out = np.empty(len(action))
        seen = self.for_base(given)
        if is_deterministic(self.base):
            _log_prob(applied(self.base.decide(seen).actions), action, self.epsilon, self.per_dimension, out)
        else:
            _log_mixture(self.base.log_density(seen, action), action, self.epsilon, out)
        return out

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
def _log(x: float) -> float:
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
    log_kept, log_replaced = _log(1.0 - epsilon), _log(epsilon)
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
        a = _log(1.0 - epsilon) + base[i]
        b = _log(epsilon) + _log_uniform(action, i)
        top, bottom = max(a, b), min(a, b)
        out[i] = base[i] if np.isnan(base[i]) else top + log(1.0 + exp(bottom - top))
