"""Behaviour policies, one per module. All modules of this folder are imported, so there is no list to extend.

`Policy`, `Deterministic` and `Wrapper` are the base classes, also for policies of other packages, which an
experiment names with `kind: custom`. `ibdata.testing.check_policy` checks a policy.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Iterable, Iterator
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any, Union

from pydantic import Field

from ibdata.policies.base import OBSERVATION, Deterministic, Policy
from ibdata.policies.wrapper import Wrapper

for _module in pkgutil.iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")


def _subclasses(cls: Any) -> Iterator[type[Policy]]:
    for subclass in cls.__subclasses__():
        yield subclass
        yield from _subclasses(subclass)


# By kind, in the order of the modules. Only base classes have no default for `kind`.
POLICIES: dict[str, type[Policy]] = {
    policy.model_fields["kind"].default: policy
    for policy in sorted(_subclasses(Policy), key=lambda policy: policy.__module__)
    if not policy.model_fields["kind"].is_required()
}


def _one_of(kinds: Iterable[type[Policy]]) -> Any:
    """The type of a block of one of these kinds."""
    return Annotated[Union[tuple(kinds)], Field(discriminator="kind")]  # noqa: UP007


if TYPE_CHECKING:
    AnyPolicy = Policy
    AnyBase = Policy
    DeterministicBase = Deterministic
else:
    # The types of a wrapper's base, known once all policies are. Wrappers cannot be nested.
    AnyBase = _one_of(p for p in POLICIES.values() if not issubclass(p, Wrapper))
    DeterministicBase = _one_of(p for p in POLICIES.values() if hasattr(p, "mean_action"))
    for _policy in POLICIES.values():
        _policy.model_rebuild(_types_namespace={"AnyBase": AnyBase, "DeterministicBase": DeterministicBase})
    AnyPolicy = _one_of(POLICIES.values())


def described() -> list[dict[str, Any]]:
    """Describe every policy: its kind, its summary, and its options with default and description."""
    return [
        {
            "kind": kind,
            "summary": (policy.__doc__ or "").split("\n")[0],
            "options": [
                {
                    "name": name,
                    "required": field.is_required(),
                    "default": None if field.is_required() else field.default,
                    "description": field.description or "",
                }
                for name, field in policy.model_fields.items()
                if name not in ("kind", "name")
            ],
        }
        for kind, policy in POLICIES.items()
    ]


__all__ = [
    "OBSERVATION",
    "POLICIES",
    "AnyBase",
    "AnyPolicy",
    "Deterministic",
    "DeterministicBase",
    "Policy",
    "Wrapper",
    "described",
]
