"""The base class of policies that change the actions of another one."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator

from ibdata.policies.actions import applied
from ibdata.policies.base import Float32s, Floats, Needs, Observed, Policy, is_deterministic
from ibdata.policies.checked import distribution_of
from ibdata.policies.distributions import Distribution


def _without_name(base: Policy) -> Policy:
    if base.name is not None:
        raise ValueError("found a name in the base, expected the name beside the outer kind")
    return base


def _certain(base: Policy) -> Policy:
    if not is_deterministic(base):
        raise ValueError(
            f"found {base.kind} without deterministic: true, expected a policy that draws nothing; write "
            "that into it if it draws nothing"
        )
    return base


# Of a base: that it has no name, and that its actions are certain.
Unnamed, Certain = AfterValidator(_without_name), AfterValidator(_certain)


class Wrapper(Policy):
    """A policy that changes the actions of another one, its `base`, and sees what the base sees.

    It needs what the base needs and `own_needs`. The base uses the first of the random numbers and of the
    memory, the policy itself those that follow: `of_base` and `own` are the two parts.
    """

    base: Policy

    @property
    def own_needs(self) -> Needs:
        """What it needs beyond the needs of its base; of the history, the least."""
        return Needs(history=0)

    @property
    def needs(self) -> Needs:
        """The needs of the base and its own."""
        base, own = self.base.needs, self.own_needs
        return Needs(
            max(base.history, own.history),
            base.step_draws + own.step_draws,
            base.episode_draws + own.episode_draws,
            base.memory + own.memory,
        )

    @property
    def inner(self) -> tuple[Policy, ...]:
        """The base."""
        return (self.base,)

    def of_base(self, given: Observed) -> Observed:
        """What the base is given."""
        return given.cut(self.base.needs)

    def own(self, given: Observed) -> Observed:
        """The random numbers and the memory that the base does not use."""
        base = self.base.needs
        return given._replace(
            uniforms=np.ascontiguousarray(given.uniforms[:, base.step_draws :]),
            episode_uniforms=np.ascontiguousarray(given.episode_uniforms[:, base.episode_draws :]),
            memory=np.ascontiguousarray(given.memory[:, base.memory :]),
        )

    def base_distribution(self, observed: Observed) -> tuple[Distribution, npt.ArrayLike]:
        """The distribution of the base's action, and its memory."""
        return distribution_of(self.base, self.of_base(observed))

    def base_action(self, observed: Observed) -> tuple[Float32s, npt.ArrayLike]:
        """The actions (n, 3) of a base that draws nothing, clipped and rounded, and its memory."""
        distribution, memory = self.base_distribution(observed)
        return applied(distribution.sample(observed.uniforms)), memory

    def remembered(self, base: npt.ArrayLike, own: Floats) -> npt.ArrayLike:
        """The memory of the base followed by the policy's own."""
        return np.concatenate([base, own], axis=1) if self.base.needs.memory else own
