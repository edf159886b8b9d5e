"""Behaviour policies. All modules of this folder are imported, so there is no list to extend.

Write `decide`, state what the policy `needs`, and run `ibdata.testing.check_policy`; `ibdata.policies.base`
is the page to read. An experiment names a policy of another package with `kind: custom`.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Iterable, Iterator, Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any, Union

from pydantic import Field, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.fields import FieldInfo
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema
from pydantic_core.core_schema import no_info_before_validator_function

from ibdata.policies.adapter import can_act
from ibdata.policies.base import (
    OBSERVATION,
    Decision,
    Deterministic,
    FrozenModel,
    Needs,
    Observed,
    Policy,
    at_start,
)
from ibdata.policies.compound import Choice, Wrapper
from ibdata.policies.distributions import Certain, ClippedNormal, Distribution, Uniform

for _module in pkgutil.iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")


def _subclasses(cls: Any) -> Iterator[type[Policy]]:
    for subclass in cls.__subclasses__():
        yield subclass
        yield from _subclasses(subclass)


# By kind, in alphabetical order. Only base classes have no default for `kind`.
POLICIES: dict[str, type[Policy]] = dict(
    sorted(
        (policy.model_fields["kind"].default, policy)
        for policy in _subclasses(Policy)
        if not policy.model_fields["kind"].is_required()
    )
)


class _BareName:
    """An annotation that lets a bare name, or an object that acts, stand for the block of a policy."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return no_info_before_validator_function(_block_of, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        block = handler(schema)
        complete = [kind for kind in block["discriminator"]["mapping"] if not _required(POLICIES[kind])]
        return {"anyOf": [{"enum": complete, "type": "string"}, block]}


def _block_of(value: Any) -> Any:
    """The block {kind: name} of a name, or that of an object of Python's; anything else as it is."""
    if isinstance(value, str):
        return {"kind": value}
    if isinstance(value, Mapping) and value.get("kind") == "custom" and can_act(value.get("target")):
        return {**value, "kind": "live"}
    is_policy = type(value) in POLICIES.values()
    return {"kind": "live", "target": value} if can_act(value) and not is_policy else value


def _required(policy: type[Policy]) -> list[str]:
    """The options of a policy that have no default."""
    return [name for name, option in policy.model_fields.items() if option.is_required()]


def _may_be_certain(policy: type[Policy]) -> bool:
    """Whether a policy's actions are certain, or may be so by its option `deterministic`."""
    return issubclass(policy, Deterministic) or "deterministic" in policy.model_fields


def _one_of(kinds: Iterable[type[Policy]]) -> Any:
    """The type of a block of one of these kinds, or of its bare name."""
    return Annotated[Union[tuple(kinds)], Field(discriminator="kind"), _BareName()]  # noqa: UP007


if TYPE_CHECKING:
    AnyPolicy = Policy
    AnyBase = Policy
    DeterministicBase = Deterministic
else:
    # The types of policies within others, known once all policies are.
    AnyPolicy = _one_of(POLICIES.values())
    AnyBase = _one_of(p for p in POLICIES.values() if not issubclass(p, Wrapper | Choice))
    DeterministicBase = _one_of(p for p in POLICIES.values() if _may_be_certain(p))
    for _block in _subclasses(FrozenModel):
        _block.model_rebuild(
            _types_namespace={
                "AnyPolicy": AnyPolicy,
                "AnyBase": AnyBase,
                "DeterministicBase": DeterministicBase,
            }
        )


def _plain_default(field: FieldInfo) -> Any:
    """The default of an option as JSON holds it; None where there is none."""
    if field.is_required():
        return None
    return field.default.form() if isinstance(field.default, Policy) else field.default


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
    "OBSERVATION",
    "POLICIES",
    "AnyBase",
    "AnyPolicy",
    "Certain",
    "ClippedNormal",
    "Decision",
    "Deterministic",
    "DeterministicBase",
    "Distribution",
    "Needs",
    "Observed",
    "Policy",
    "Uniform",
    "Wrapper",
    "at_start",
    "described",
]
