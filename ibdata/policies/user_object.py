"""Policies that act through an object of a user: what `custom` and `live` have in common."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, PrivateAttr, model_validator

from ibdata.errors import PolicyError
from ibdata.policies.adapter import Adapter, needs_of
from ibdata.policies.base import OBSERVATION, Decision, Needs, Observed, Policy
from ibdata.policies.libraries import environment_note
from ibdata.policies.purity import refuse_impure
from ibdata.views.options import PLAIN, ViewOptions

MOST_CLIPPED = 0.2  # share of the numbers of actions


class UserObject(Policy):
    """A policy that acts through an object of a user, see `Adapter`."""

    history: Annotated[int, Field(strict=True, ge=1, le=10_000)] = Field(
        default=1, description="number of observations that it sees"
    )
    uniforms: Annotated[int, Field(strict=True, ge=0, le=10_000)] = Field(
        default=0, description="number of uniform random numbers per step for act and decide"
    )
    deterministic: bool = Field(
        default=False, strict=True, description="promise that it draws no random numbers of any kind"
    )

    _is_pure: bool = PrivateAttr(False)

    @model_validator(mode="after")
    def _refuse_draws(self) -> UserObject:
        if self.deterministic and self.uniforms:
            raise ValueError(
                f"found deterministic: true and uniforms: {self.uniforms}, expected only "
                "one of them, because a deterministic policy draws nothing"
            )
        return self

    @property
    def adapted(self) -> Any:
        """The object."""
        raise NotImplementedError

    @property
    def code_target(self) -> str:
        """What names the object in records and messages."""
        raise NotImplementedError

    @property
    def needs(self) -> Needs:
        """The options; an object with `decide` also says what it remembers and draws for an episode."""
        needs = needs_of(self.adapted, self.history, self.uniforms)
        return needs._replace(history=self.history, step_draws=self.uniforms)

    def files_used(self) -> dict[str, Path]:
        """The files that it reads, by their names in a record."""
        return {}

    def target_file(self) -> Path | None:
        """The file of its code, if one is known."""
        return None

    @cached_property
    def adapter(self) -> Adapter:
        """The object as it is asked."""
        return Adapter(self.adapted)

    @property
    def remembers(self) -> bool:
        """Whether the object keeps something between steps beside its memory."""
        return self.adapter.remembers

    def decide(self, observed: Observed) -> Decision:
        answer = self.adapter.ask(observed)
        return Decision(answer.action, answer.memory)

    def check_once(self, columns: int = len(OBSERVATION)) -> None:
        """Make the object, and check that it is pure, unless that was done before.

        It sees so many `columns` of an observation. Raises PolicyError if it cannot be loaded, or if it
        remembers or draws in secret.
        """
        if not self._is_pure:
            refuse_impure(self, columns, exact=False)
            self.adapter.clipped[:] = 0  # what was asked here is made up
            self._is_pure = True

    def forget(self) -> None:
        """Forget the object, so that it is made anew on its next use."""
        self._is_pure = False
        for name in ("adapted", "adapter"):
            self.__dict__.pop(name, None)

    def notes(self, view: ViewOptions = PLAIN) -> Iterator[str]:
        """What somebody should know who uses the object with a view, in lines without its name."""
        if note := environment_note(self.adapted, view):
            yield note
        clipped, total = self.adapter.clipped.tolist()
        yield from clipping_notes(clipped, total, "numbers of its actions")


def clipping_notes(clipped: float, total: float, what: str) -> Iterator[str]:
    """A line that says so if many are clipped."""
    if clipped > MOST_CLIPPED * total:
        yield f"{clipped / total:.0%} of the {what} are clipped: actions are changes in [-1, 1]"


def refuse_shared(policy: Policy) -> None:
    """Raise PolicyError for a policy in which an object that remembers acts in two places."""
    parts = [part for part in policy.everywhere(UserObject) if part.remembers]
    if len({id(part.adapted) for part in parts}) < len(parts):
        raise PolicyError(
            f"policy {policy.label}: found {parts[0].code_target} in two places, expected an object for "
            "each, because it remembers the episodes in which it acts"
        )
