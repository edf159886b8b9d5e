"""The base class of policies that change the actions of another one."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator

from ibdata.policies.actions import applied
from ibdata.policies.base import Floats, Policy, is_deterministic
from ibdata.policies.given import Given


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
    """A policy that changes the actions of another one, its `base`.

    It sees the same observations as the base, and the actions before them. The base uses the first of the
    random numbers and of the memory; the policy itself uses the other `own_uniforms_per_step` and
    `own_memory_size`. `for_base` and `own` separate them.
    """

    own_uniforms_per_step: ClassVar[int] = 0
    own_memory_size: ClassVar[int] = 0
    own_uniforms_per_episode: ClassVar[int] = 0

    base: Policy

    @property
    def history_length(self) -> int:  # type: ignore[override]  # read from instances only
        """The number of observations that the base sees."""
        return self.base.history_length

    @property
    def uniforms_per_step(self) -> int:  # type: ignore[override]  # read from instances only
        """The number of uniform random numbers per step, of the base and of the policy itself."""
        return self.base.uniforms_per_step + self.own_uniforms_per_step

    @property
    def uniforms_per_episode(self) -> int:  # type: ignore[override]  # read from instances only
        """The number of uniform random numbers per episode, of the base and of the policy itself."""
        return self.base.uniforms_per_episode + self.own_uniforms_per_episode

    @property
    def memory_size(self) -> int:  # type: ignore[override]  # read from instances only
        """The number of numbers that are remembered, those of the base and of the policy itself."""
        return self.base.memory_size + self.own_memory_size

    @property
    def inner(self) -> tuple[Policy, ...]:
        """The base."""
        return (self.base,)

    def form(self) -> dict[str, Any]:
        """The form of the policy, which contains the form of the base unless that is the default."""
        form = super().form()
        return {**form, "base": self.base.form()} if "base" in form else form

    def for_base(self, given: Given) -> Given:
        """The part that the base gets: the first random numbers, and the first numbers of the memory."""
        return part_of(self.base, given)

    def own(self, given: Given) -> Given:
        """The part that is the policy's own: the random numbers and the memory that the base does not use."""
        base = self.base
        return given._replace(
            uniforms=np.ascontiguousarray(given.uniforms[:, base.uniforms_per_step :]),
            episode_uniforms=np.ascontiguousarray(given.episode_uniforms[:, base.uniforms_per_episode :]),
            memory=np.ascontiguousarray(given.memory[:, base.memory_size :]),
        )

    def joined(self, base: npt.ArrayLike, own: Floats) -> npt.ArrayLike:
        """Join the memory of the base with the policy's own."""
        return np.concatenate([base, own], axis=1) if self.base.memory_size else own

    def base_action(self, given: Given) -> tuple[npt.NDArray[np.float32], npt.ArrayLike]:
        """Return the base's actions (n, 3), clipped and rounded, and its memory."""
        chosen = self.base.decide(self.for_base(given))
        return applied(chosen.actions), chosen.memory


def part_of(policy: Policy, given: Given) -> Given:
    """The first observations, actions, random numbers and memory, as many as a policy uses."""
    frames = policy.history_length
    return Given(
        np.ascontiguousarray(given.observations[:, :frames]),
        np.ascontiguousarray(given.actions[:, :frames]),
        given.step,
        np.ascontiguousarray(given.uniforms[:, : policy.uniforms_per_step]),
        np.ascontiguousarray(given.episode_uniforms[:, : policy.uniforms_per_episode]),
        np.ascontiguousarray(given.memory[:, : policy.memory_size]),
    )
