"""A base policy whose last action is repeated now and then."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from ibdata.numerics.compiled import compiled
from ibdata.numerics.exact import exp, log
from ibdata.policies.base import Bools, Decision, Float32s, Floats, Needs, Observed, is_deterministic
from ibdata.policies.epsilon_greedy import Probability, log_share
from ibdata.policies.wrapper import Unnamed, Wrapper

if TYPE_CHECKING:
    from ibdata.policies import AnyPolicy


class Sticky(Wrapper):
    """Repeats the last action with probability κ; else, and at the first step, the base acts.

    An action is held for 1/(1 - κ) steps on average. The density is NaN if the base is a custom policy
    without `deterministic: true`. Source: Machado et al. 2018, Revisiting the Arcade Learning Environment,
    where sticky actions belong to the environment.
    """

    own_needs: ClassVar[Needs] = Needs(history=1, step_draws=1)

    kind: Literal["sticky"] = "sticky"
    base: Annotated[AnyPolicy, Unnamed] = Field(description="the policy whose actions are repeated")
    kappa: Probability = Field(description="probability of repeating the last action, in [0, 1]")

    def decide(self, given: Observed) -> Decision:
        base, memory = self.base_action(given)
        repeats = (self.own(given).uniforms[:, 0] < self.kappa) & (given.step > 0)
        return Decision(np.where(repeats[:, None], given.actions[:, 0], base), memory)

    def log_density(self, given: Observed, action: Float32s) -> Floats:
        """The log density (n,), which is log(1 - κ) more than the base's, except at the last action.

        There it is log(κ + (1 - κ) p) if the base takes this action with a probability p, else log κ.
        """
        if any(policy.code_target and not is_deterministic(policy) for policy in self.base.everywhere()):
            return np.full(len(action), np.nan)  # nobody says where its measure has unit masses
        base = self.of_base(given)
        density = self.base.log_density(base, action)
        certain: Bools = np.asarray(self.base.atoms(base, action).all(axis=1))
        return _with_repeats(density, self._repeated(given, action), certain, self._kappa(given))

    def atoms(self, given: Observed, action: Float32s) -> Bools:
        return self._repeated(given, action)[:, None] | self.base.atoms(self.of_base(given), action)

    def _kappa(self, given: Observed) -> Floats:
        """The probability of repeating the last action (n,), which is 0 at the first step."""
        return np.where(given.step > 0, self.kappa, 0.0)

    def _repeated(self, given: Observed, action: Float32s) -> Bools:
        """Whether actions may be the last ones again, (n,)."""
        same: Bools = (action == given.actions[:, 0]).all(axis=1) & (self._kappa(given) > 0.0)
        return same


@compiled
def _with_repeats(density: Floats, repeated: Bools, certain: Bools, kappa: Floats) -> Floats:
    out = density.copy()
    for i in range(out.shape[0]):
        if np.isnan(out[i]) or not repeated[i]:
            out[i] += log_share(1.0 - kappa[i])
        else:
            out[i] = log(kappa[i] + ((1.0 - kappa[i]) * exp(out[i]) if certain[i] else 0.0))
    return out
