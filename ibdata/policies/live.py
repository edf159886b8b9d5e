"""Objects of a Python session as policies."""

from __future__ import annotations

import re
from secrets import token_hex
from typing import Any, Literal
from weakref import WeakValueDictionary

from pydantic import Field, PrivateAttr, ValidationInfo, model_validator
from pydantic.functional_validators import ModelWrapValidatorHandler

from ibdata.errors import PolicyError
from ibdata.policies.adapter import can_act, needs_of
from ibdata.policies.base import Policy
from ibdata.policies.user_object import UserObject

LIVE = "live:"  # begins the name of an object in a record of code


class Held:
    """Keeps an object as long as a policy, or a copy of it, acts through it."""

    def __init__(self, target: Any) -> None:
        self.target = target


_held_by_run: WeakValueDictionary[str, Held] = WeakValueDictionary()


class Live(UserObject):
    """Acts through an object of a Python session, and in that session only.

    Python makes it of a function, a torch module or any other object among the policies. Its code is not
    recorded, so nobody can make the dataset again.
    """

    kind: Literal["live"] = "live"
    target: str = Field(description="the name of the object's class, or of the function")
    run: str = Field(description="a name for the object, by which its session knows it")

    _held: Held | None = PrivateAttr(None)

    @model_validator(mode="wrap")
    @classmethod
    def _with_object(cls, data: Any, handler: ModelWrapValidatorHandler[Live], _: ValidationInfo) -> Live:
        """Find the object of a block, or take the target of a new one, which may set its own needs."""
        target = data.get("target") if isinstance(data, dict) else None
        if not can_act(target):
            policy = handler(data)
            policy._held = _held_by_run.get(policy.run)
            return policy
        needs, held, run = needs_of(target), Held(target), token_hex(16)
        name = target.name if isinstance(target, Policy) else None
        block = {"history": max(1, needs.history), "uniforms": needs.step_draws, "name": name, **data}
        policy = handler({**block, "target": getattr(target, "__name__", type(target).__name__), "run": run})
        _held_by_run[run] = policy._held = held
        return policy

    @property
    def label(self) -> str:
        """The policy's label in the data, by default made of the object's name."""
        name = re.sub("[^a-z0-9]", "-", self.target.lower()).strip("-")[:64]
        return self.name or name or "object"

    @property
    def code_target(self) -> str:
        """The object's name, as that of a live object."""
        return LIVE + self.target

    @property
    def is_held(self) -> bool:
        """Whether the object is one of this session, and is still there."""
        return self._held is not None

    @property
    def adapted(self) -> Any:
        """The object. Raises PolicyError if it is gone."""
        if self._held is None:
            raise PolicyError(f"{self.code_target}: found no such object in this Python session")
        return self._held.target


def without_runs(form: Any) -> Any:
    """A form in which live objects have no name of a run, so that each call draws the same numbers."""
    if isinstance(form, list):
        return [without_runs(item) for item in form]
    if not isinstance(form, dict):
        return form
    is_live = form.get("kind") == "live"
    return {key: without_runs(value) for key, value in form.items() if not (is_live and key == "run")}
