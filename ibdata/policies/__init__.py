"""Behaviour policies. All modules of this folder are imported, so there is no list to extend.

Write `decide`, state what the policy `needs`, and run `ibdata.testing.check_policy`; `ibdata.policies.base`
is the page to read. An experiment names a policy of another package with `kind: custom`.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Iterator
from importlib import import_module
from typing import Any

from pydantic.fields import FieldInfo

from ibdata.policies.base import (
    OBSERVATION,
    Decision,
    Deterministic,
    Needs,
    Observed,
    Policy,
    at_start,
)
from ibdata.policies.compound import POLICIES, AnyPolicy, Wrapper
from ibdata.policies.distributions import Certain, ClippedNormal, Distribution, Uniform

for _module in pkgutil.iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")


def _subclasses(cls: Any) -> Iterator[type[Policy]]:
    for subclass in cls.__subclasses__():
        yield subclass
        yield from _subclasses(subclass)


# Only base classes have no default for `kind`.
POLICIES.update(
    sorted(
        (policy.model_fields["kind"].default, policy)
        for policy in _subclasses(Policy)
        if not policy.model_fields["kind"].is_required()
    )
)

NAMED = tuple(kind for kind in POLICIES if kind != "live")  # by a text; Python makes the other of an object


def _plain_default(field: FieldInfo) -> Any:
    """The default of an option as JSON holds it; None where there is none."""
    if field.is_required():
        return None
    return field.default.form() if isinstance(field.default, Policy) else field.default


def policy_list() -> list[dict[str, Any]]:
    """Describe every policy: its kind, its summary, and its options with default and description."""
    return [
        {
            "kind": kind,
            "summary": (policy.__doc__ or "").split("\n")[0],
            "options": [
                {
                    "name": name,
                    "required": field.is_required(),
                    "default": _plain_default(field),
                    "description": field.description or "",
                }
                for name, field in policy.model_fields.items()
                if name not in ("kind", "name")
            ],
        }
        for kind, policy in POLICIES.items()
    ]


__all__ = [
    "NAMED",
    "OBSERVATION",
    "POLICIES",
    "AnyPolicy",
    "Certain",
    "ClippedNormal",
    "Decision",
    "Deterministic",
    "Distribution",
    "Needs",
    "Observed",
    "Policy",
    "Uniform",
    "Wrapper",
    "at_start",
    "policy_list",
]
