"""A base policy whose action is replaced by a random one now and then."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, Field

from ibdata.numerics.compiled import compiled
from ibdata.numerics.exact import exp, log
from ibdata.policies.actions import applied, log_certain
from ibdata.policies.base import Bools, Decision, Float32s, Floats, Needs, Observed, is_deterministic
from ibdata.policies.random import log_uniform
from ibdata.policies.wrapper import Unnamed, Wrapper

if TYPE_CHECKING:
    from ibdata.policies import AnyBase

Probability = Annotated[
    float,
    Field(ge=0.0, le=1.0, strict=True, allow_inf_nan=False),
    AfterValidator(lambda value: value + 0.0),
]


class EpsilonGreedy(Wrapper):
    """Replaces the base's action with probability ε at each step by one drawn from U(-1, 1)³.

    The whole action is replaced. In `siemens-research/lion`, generate_data.py does so in its toy environment;
    we infer that the published Industrial Benchmark data were made in the same way.
    """

    own_needs: ClassVar[Needs] = Needs(history=0, step_draws=4)  # one that decides, three for the action

    kind: Literal["epsilon_greedy"] = "epsilon_greedy"
    base: Annotated[AnyBase, Unnamed] = Field(description="the policy whose actions are replaced")
    epsilon: Probability = Field(description="probability of a random action, in [0, 1]")

    def decide(self, given: Observed) -> Decision:
        base, memory = self.base_action(given)
        return Decision(self._replaced(base, given), memory)

    def decide_with_density(self, given: Observed) -> tuple[Decision, Floats | None]:
        """Return both at once; a base whose action is certain decides only once."""
        if not is_deterministic(self.base):
            return super().decide_with_density(given)
        base, memory = self.base_action(given)
        actions = applied(self._replaced(base, given))
        return Decision(actions, memory), self._log_replaced(log_certain(base, actions), actions)

    def log_density(self, given: Observed, action: Float32s) -> Floats:
        """The log density (n,) of the mixture; at an action that the base is certain of, log(1 - ε)."""
        return self._log_replaced(self.base.log_density(self.of_base(given), action), action)

    def atoms(self, given: Observed, action: Float32s) -> Bools:
        return self.base.atoms(self.of_base(given), action) & (self.epsilon < 1.0)

    def _replaced(self, base: Float32s, given: Observed) -> Floats:
        return replaced(base, self.own(given).uniforms, np.full(len(base), self.epsilon))

    def _log_replaced(self, density: Floats, action: Float32s) -> Floats:
        certain: Bools = (density == 0.0) & is_deterministic(self.base)
        return log_replaced(density, certain, action, np.full(len(action), self.epsilon))


@compiled
def log_share(x: float) -> float:
    """Logarithm of a share, -inf if it is 0."""
    return log(x) if x > 0.0 else -np.inf


@compiled
def replaced(base: Float32s, u: Floats, epsilon: Floats) -> Floats:
    """The base's actions (n, 3), some replaced as a whole by u (n, 4), with the probabilities ε (n,)."""
    out = np.empty((base.shape[0], 3))
    for i in range(out.shape[0]):
        for j in range(3):
            out[i, j] = 2.0 * u[i, 1 + j] - 1.0 if u[i, 0] < epsilon[i] else np.float64(base[i, j])
    return out


@compiled
def log_replaced(base: Floats, certain: Bools, action: Float32s, epsilon: Floats) -> Floats:
    """The log densities (n,) of actions that `replaced` returned, from those of the base; NaN stays.

        log((1 - ε) b + ε u), with the densities b of the base and u of U(-1, 1)³

    Where the base is certain of the whole action, u has no mass there, and the result is log((1 - ε) b).
    """
    out = np.empty(base.shape[0])
    share, log_kept, log_random = -1.0, 0.0, 0.0
    for i in range(out.shape[0]):
        out[i] = base[i]
        if np.isnan(base[i]) or epsilon[i] == 0.0:
            continue
        if epsilon[i] != share:
            share, log_kept, log_random = epsilon[i], log_share(1.0 - epsilon[i]), log(epsilon[i])
        a, b = log_kept + base[i], log_random + log_uniform(action, i)
        inside = min(abs(action[i, 0]), abs(action[i, 1]), abs(action[i, 2])) < 1.0
        if certain[i] and inside and share < 1.0:
            out[i] = a
        elif a == -np.inf:
            out[i] = b
        else:
            out[i] = max(a, b) + log(1.0 + exp(min(a, b) - max(a, b)))
    return out
