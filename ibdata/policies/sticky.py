"""A base policy whose last action is repeated now and then."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from ibdata.numerics.compiled import compiled
from ibdata.numerics.exact import exp, log
from ibdata.policies.base import Floats, is_deterministic
from ibdata.policies.epsilon_greedy import Probability, log_share
from ibdata.policies.given import Decision, Given
from ibdata.policies.support import LAST, Support, whole
from ibdata.policies.wrapper import Unnamed, Wrapper

if TYPE_CHECKING:
    from ibdata.policies import AnyPolicy


class Sticky(Wrapper):
    """Repeats the last action with probability κ; else, and at the first step, the base acts.

    An action is held for 1/(1 - κ) steps on average. The density has a unit mass at the last action; it is
    not known (NaN) if the base is a custom policy without `deterministic: true`. Source: the sticky actions
    of Machado et al. 2018, Revisiting the Arcade Learning Environment; there they belong to the environment.
    """

    own_uniforms_per_step: ClassVar[int] = 1

    kind: Literal["sticky"] = "sticky"
    base: Annotated[AnyPolicy, Unnamed] = Field(description="the policy whose actions are repeated")
    kappa: Probability = Field(description="probability of repeating the last action, in [0, 1]")

    @property
    def history_length(self) -> int:  # type: ignore[override]  # read from instances only
        """As many observations and actions as the base sees, and at least the last action."""
        return max(1, self.base.history_length)

    def decide(self, given: Given) -> Decision:
        base, memory = self.base_action(given)
        repeats = (self.own(given).uniforms[:, 0] < self.kappa) & (given.step > 0)
        actions = np.where(repeats[:, None], given.actions[:, 0], base)
        return Decision(actions, memory)

    def log_density(self, given: Given, action: npt.NDArray[np.float32]) -> Floats:
        """Return the log density (n,) of actions.

        It is log(1 - κ) more than the base's, except at the last action: there it is log(κ + (1 - κ) p) if
        the base takes this action with a probability p, else log κ.
        """
        if any(policy.code_target and not is_deterministic(policy) for policy in self.base.everywhere()):
            return np.full(len(action), np.nan)  # nobody says where its measure has unit masses
        base, out = self.for_base(given), np.empty(len(action))
        density = self.base.log_density(base, action)
        mass = np.asarray(self.base.atoms(base, action).all(axis=1))
        _log_density(self._is_last(given, action), density, mass, self._kappa(given), out)
        return out

    def supports(self, step: int) -> tuple[Support, ...] | None:
        base = self.base.supports(step)
        if base is None or step == 0 or self.kappa == 0.0:
            return base
        return (whole(LAST),) if self.kappa == 1.0 else tuple(support | whole(LAST) for support in base)

    def atoms(self, given: Given, action: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
        possible = self._is_last(given, action) & (self._kappa(given) > 0.0)
        return possible[:, None] | self.base.atoms(self.for_base(given), action)

    def _kappa(self, given: Given) -> Floats:
        """The probability of repeating the last action (n,), which is 0 at the first step."""
        return np.where(given.step > 0, self.kappa, 0.0)

    @staticmethod
    def _is_last(given: Given, action: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
        last: npt.NDArray[np.bool_] = (action == given.actions[:, 0]).all(axis=1)
        return last


@compiled
def _log_density(
    last: npt.NDArray[np.bool_], base: Floats, mass: npt.NDArray[np.bool_], kappa: Floats, out: Floats
) -> None:
    for i in range(out.shape[0]):
        if np.isnan(base[i]) or not (last[i] and kappa[i] > 0.0):
            out[i] = base[i] + log_share(1.0 - kappa[i])
        else:
            out[i] = log(kappa[i] + ((1.0 - kappa[i]) * exp(base[i]) if mass[i] else 0.0))
