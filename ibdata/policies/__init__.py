"""Behaviour policies, one a file. Every module of this folder is read; nothing else lists them."""

from __future__ import annotations

import pkgutil
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any, Union

from pydantic import Field

from ibdata.policies.base import OBSERVATION, Policy

for _module in pkgutil.iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")


def _leaves(cls: Any) -> list[type[Policy]]:
    return [leaf for sub in cls.__subclasses__() for leaf in _leaves(sub)] or [cls]


POLICIES: dict[str, type[Policy]] = {
    policy.model_fields["kind"].default: policy
    for policy in sorted(_leaves(Policy), key=lambda policy: policy.__module__)
}

if TYPE_CHECKING:
    AnyPolicy = Policy
else:
    AnyPolicy = Annotated[Union[tuple(POLICIES.values())], Field(discriminator="kind")]  # noqa: UP007

__all__ = ["OBSERVATION", "POLICIES", "AnyPolicy", "Policy"]
