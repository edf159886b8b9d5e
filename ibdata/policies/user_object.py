"""Policies that act through an object of a user: what all have in common, and those of a Python session."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator, Field, PlainSerializer, PrivateAttr, WithJsonSchema, model_validator

from ibdata.errors import PolicyError, excerpt
from ibdata.policies.adapter import EXPECTED, Adapter, can_act, needs_of
from ibdata.policies.base import OBSERVATION, Decision, Needs, Observed, Policy
from ibdata.policies.code import Acting
from ibdata.policies.libraries import environment_note
from ibdata.policies.purity import refuse_impure
from ibdata.views.options import PLAIN, ViewOptions

if TYPE_CHECKING:
    from typing_extensions import Self

LIVE = "live:"  # begins the name of an object in a record of code
MOST_CLIPPED = 0.2  # share of the numbers of actions


class UserObject(Policy):
    """A policy that acts through an object of a user, see `Adapter`."""

    history: Annotated[int, Field(strict=True, ge=1, le=10_000)] = Field(
        default=1, description="number of observations that it sees"
    )
    draws: Annotated[int, Field(strict=True, ge=0, le=10_000)] = Field(
        default=0, description="number of uniform random numbers per step for act and decide"
    )
    deterministic: bool = Field(
        default=False, strict=True, description="promise that it draws no random numbers of any kind"
    )

    _adapter: Adapter | None = PrivateAttr(None)

    @model_validator(mode="after")
    def _refuse_draws(self) -> UserObject:
        if self.deterministic and self.draws:
            raise ValueError(
                f"found deterministic: true and draws: {self.draws}, expected only "
                "one of them, because a deterministic policy draws nothing"
            )
        return self

    @property
    def code_target(self) -> str:
        """What names the object in records and messages."""
        raise NotImplementedError

    @property
    def needs(self) -> Needs:
        """The options; an object with `decide` also says what it remembers and draws for an episode."""
        needs = needs_of(self.adapter.target, self.history, self.draws)
        return needs._replace(history=self.history, draws=self.draws)

    def loaded(self, acting: Acting) -> Self:
        acting.callback(os.chdir, acting.folder)  # the object may go elsewhere
        copy = self.__copy__()
        target = copy._made(acting)
        copy._adapter = Adapter(target.loaded(acting) if isinstance(target, Policy) else target)
        return copy

    def _made(self, acting: Acting) -> Any:
        """The object, which is found or made."""
        raise NotImplementedError

    def files_used(self) -> dict[str, Path]:
        """The files that it reads, by their names in a record."""
        return {}

    def target_file(self) -> Path | None:
        """The file of its code, if one is known."""
        return None

    @property
    def adapter(self) -> Adapter:
        """The object as it is asked, which is loaded."""
        if self._adapter is None:
            raise PolicyError(
                f"{self.code_target}: found a policy that is not loaded, as evaluate and generate load it"
            )
        return self._adapter

    @property
    def remembers(self) -> bool:
        """Whether the object keeps something between steps beside its memory."""
        return self.adapter.remembers

    def decide(self, observed: Observed) -> Decision:
        answer = self.adapter.ask(observed)
        return Decision(answer.action, answer.memory)

    def refuse_impure(self, columns: int = len(OBSERVATION)) -> None:
        """Raise PolicyError if it remembers or draws in secret. It sees so many columns of an observation."""
        refuse_impure(self, columns, exact=False)
        self.adapter.clipped[:] = 0  # what was asked here is made up

    def notes(self, view: ViewOptions = PLAIN) -> Iterator[str]:
        """What somebody should know who uses the object with a view, in lines without its name."""
        if note := environment_note(self.adapter.target, view):
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
    if len({id(part.adapter.target) for part in parts}) < len(parts):
        raise PolicyError(
            f"policy {policy.label}: found {parts[0].code_target} in two places, expected an object for "
            "each, because it remembers the episodes in which it acts"
        )


def _acting(target: Any) -> Any:
    if isinstance(target, str) or can_act(target):
        return target
    raise ValueError(f"found {excerpt(target)}, expected {EXPECTED}")


def name_of(target: Any) -> str:
    """The name of a function, or of an object's class; that of an object in a record is the target."""
    return target if isinstance(target, str) else getattr(target, "__name__", type(target).__name__)


class ObjectPolicy(UserObject):
    """Acts through an object of a Python session, and in that session only.

    Python makes it of a function, a torch module or any other object among the policies. Its code is not
    recorded, so nobody can make the dataset again.
    """

    kind: Literal["live"] = "live"
    target: Annotated[
        Any, BeforeValidator(_acting), PlainSerializer(name_of, str), WithJsonSchema({"type": "string"})
    ] = Field(description="the object; in a record the name of its class, or of the function")

    @model_validator(mode="before")
    @classmethod
    def _as_it_needs(cls, data: Any) -> Any:
        """Let an object set its own needs and name, unless they are given."""
        target = data.get("target") if isinstance(data, dict) else None
        if isinstance(target, str) or not can_act(target):
            return data
        needs, name = needs_of(target), target.name if isinstance(target, Policy) else None
        return {"history": max(1, needs.history), "draws": needs.draws, "name": name, **data}

    @cached_property
    def inner(self) -> tuple[Policy, ...]:
        """None, also if the object is a policy: only its name is said."""
        return ()

    def form(self) -> dict[str, Any]:
        """The kind and the options, with the name of the object in its place."""
        return {**super().form(), "target": name_of(self.target)}

    @property
    def label(self) -> str:
        """The policy's label in the data, by default made of the object's name."""
        name = re.sub("[^a-z0-9]", "-", name_of(self.target).lower()).strip("-")[:64]
        return self.name or name or "object"

    @property
    def code_target(self) -> str:
        """The object's name, as that of an object of a session."""
        return LIVE + name_of(self.target)

    @property
    def is_here(self) -> bool:
        """Whether the object itself is here, and not only its record."""
        return not isinstance(self.target, str)

    def _made(self, acting: Acting) -> Any:
        if not self.is_here:
            raise PolicyError(f"{self.code_target}: found no such object in this Python session")
        return self.target
